// Mitsuba scenes (XML of versions 0.5, 0.6, 2 and 3): which reader takes which part.
#include <algorithm>

#include "src/scene/import_detail.h"
#include "src/scene/mitsuba_lights.h"
#include "src/scene/mitsuba_shapes.h"

namespace trex::detail {
namespace mitsuba {
namespace {

/// Mitsuba counts the segments of a path, so that one of 1 sees emission alone; without or with a
/// negative one there is no limit. Integrators within others (aov, moment) count too.
void readIntegrator(Context& context, const Element& integrator) {
  const Properties of(context, integrator);
  const double depth = integrator.type() == "direct" ? 2.0 : of.number("max_depth", -1.0);
  if (depth >= 0.0) {
    context.scene().maxBounces = static_cast<std::uint32_t>(std::clamp(depth - 1.0, 0.0, 1e9));
  }
  if (depth == 0.0) {
    context.note(integrator, "max_depth 0 would be a black picture; emission is shown, as with 1");
  }
  if (of.flag("hide_emitters", false)) {
    context.replace(integrator,
                    "hide_emitters: what shines is seen all the same; --transparent leaves the "
                    "background out");
  }
  for (const Element* inner : of.objects("integrator")) readIntegrator(context, *inner);
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
      readIntegrator(context, e);
    } else if (e.tag == "subsurface" || e.tag == "volume") {
      context.replace(e, fmt::format("<{}> is not shown", e.tag));
    }
  }
  return std::move(context.scene());
}

}  // namespace trex::detail
