// Mitsuba scenes (XML of versions 0.5, 0.6, 2 and 3): which reader takes which part.
#include "src/scene/import_detail.h"
#include "src/scene/mitsuba_lights.h"
#include "src/scene/mitsuba_shapes.h"

namespace trex::detail {
namespace mitsuba {
namespace {

void noteIntegrator(Context& context, const Element& integrator) {
  const Properties of(context, integrator);
  const double depth = of.number("max_depth", -1.0);
  if (depth < 0.0) return;
  context.note(
      integrator,
      fmt::format("paths longer than max_depth {} are shown too: chance alone ends them", depth));
}

}  // namespace
}  // namespace mitsuba

Scene readMitsuba(const std::filesystem::path& path, const ImportOptions& options) {
  using namespace mitsuba;
  Context context(path, options);
  Textures textures(context);
  Bsdfs bsdfs(context, textures);
  Shapes shapes(context, textures, bsdfs);
  for (const Element& e : context.document().root().children) {
    if (e.tag == "shape") {
      shapes.add(e);
    } else if (e.tag == "emitter" || e.tag == "luminaire") {
      addEmitter(context, e);
    } else if (e.tag == "sensor" || e.tag == "camera") {
      addSensor(context, e);
    } else if (e.tag == "integrator") {
      noteIntegrator(context, e);
    } else if (e.tag == "subsurface" || e.tag == "volume") {
      context.replace(e, fmt::format("<{}> is not shown", e.tag));
    }
  }
  return std::move(context.scene());
}

}  // namespace trex::detail
