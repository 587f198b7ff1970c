#include "src/scene/chromaticities.h"

namespace trex::detail {
namespace {

dvec3 xyzOf(const glm::dvec2& p) { return dvec3(p.x / p.y, 1.0, (1.0 - p.x - p.y) / p.y); }

/// Takes one white to another.
glm::dmat3 adapted(const glm::dvec2& from, const glm::dvec2& to) {
  const glm::dmat3 bradford(dvec3(0.8951, -0.7502, 0.0389), dvec3(0.2664, 1.7135, -0.0685),
                            dvec3(-0.1614, 0.0367, 1.0296));
  const dvec3 ratio = (bradford * xyzOf(to)) / (bradford * xyzOf(from));
  const glm::dmat3 scale(dvec3(ratio.x, 0.0, 0.0), dvec3(0.0, ratio.y, 0.0),
                         dvec3(0.0, 0.0, ratio.z));
  return glm::inverse(bradford) * scale * bradford;
}

}  // namespace

glm::dmat3 toXyz(const Chromaticities& c) {
  const glm::dmat3 primaries(xyzOf(c[0]), xyzOf(c[1]), xyzOf(c[2]));
  const dvec3 shares = glm::inverse(primaries) * xyzOf(c[3]);
  return {primaries[0] * shares.x, primaries[1] * shares.y, primaries[2] * shares.z};
}

glm::dmat3 toRec709(const Chromaticities& c) {
  return glm::inverse(toXyz(kRec709)) * adapted(c[3], kRec709[3]) * toXyz(c);
}

}  // namespace trex::detail
