// Compiled once for each instruction set [Highway's foreach_target].
#include "src/crays/light_tree_weigh.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/crays/light_tree_weigh.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef TREX_WEIGH_ONCE
#define TREX_WEIGH_ONCE
namespace trex {
namespace {

/// A node is opened where the point is closer to its centre than this many radii.
constexpr float kClose = 1.5f;
/// Of a light that a surface sees from behind, as bounds have it: shading normals, rounding.
constexpr float kLeastBehind = 0.02f;
constexpr float kLeastFacing = 1e-3f;
constexpr float kLeastDistance2 = 1e-12f;

}  // namespace
}  // namespace trex
#endif

HWY_BEFORE_NAMESPACE();
namespace trex {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using DF = hn::CappedTag<float, LightNodes::kLanes>;
using VF = hn::Vec<DF>;
constexpr std::size_t kWidth = hn::MaxLanes(DF());
static_assert(LightNodes::kLanes % kWidth == 0);

HWY_INLINE VF set(float value) { return hn::Set(DF(), value); }
HWY_INLINE VF dot(VF ax, VF ay, VF az, VF bx, VF by, VF bz) {
  return hn::Add(hn::Add(hn::Mul(ax, bx), hn::Mul(ay, by)), hn::Mul(az, bz));
}
/// The other one of sine and cosine.
HWY_INLINE VF across(VF a) {
  return hn::Sqrt(hn::Max(hn::Zero(DF()), hn::Sub(set(1.0f), hn::Mul(a, a))));
}

/// Share of a light's power that is sent to directions with this cosine to its axis, for a node
/// whose half angle as seen from the point has these.
HWY_INLINE VF facing(const LightNodes& n, std::size_t i, VF cosine, VF cosSize, VF sinSize) {
  const DF df;
  const VF cosSpread = hn::Load(df, n.cosSpread + i), sinSpread = hn::Load(df, n.sinSpread + i);
  const VF sine = across(cosine);
  const VF cosBeyond = hn::Add(hn::Mul(cosine, cosSpread), hn::Mul(sine, sinSpread));
  const VF sinBeyond = hn::Sub(hn::Mul(sine, cosSpread), hn::Mul(cosine, sinSpread));
  const VF closest = hn::Add(hn::Mul(cosBeyond, cosSize), hn::Mul(sinBeyond, sinSize));
  const VF most = hn::IfThenElse(hn::Lt(cosBeyond, cosSize), closest, set(1.0f));
  const VF reach = hn::Sub(hn::Load(df, n.cosReach + i), set(kLeastFacing));
  const VF some = hn::IfThenZeroElse(hn::Lt(most, reach), hn::Max(most, set(kLeastFacing)));
  return hn::IfThenElse(hn::Lt(cosine, cosSpread), some, set(1.0f));
}

std::uint32_t weigh(const LightNodes& n, const vec3& position, const vec3& normal, float* weights) {
  const DF df;
  const bool oneSide = normal != vec3(0.0f);
  std::uint32_t close = 0;
  for (std::size_t i = 0; i < LightNodes::kLanes; i += kWidth) {
    const VF x = hn::Sub(set(position.x), hn::Load(df, n.x + i));
    const VF y = hn::Sub(set(position.y), hn::Load(df, n.y + i));
    const VF z = hn::Sub(set(position.z), hn::Load(df, n.z + i));
    const VF radius = hn::Load(df, n.radius + i), power = hn::Load(df, n.power + i);
    const VF distance2 = hn::Max(dot(x, y, z, x, y, z), set(kLeastDistance2));
    const VF radius2 = hn::Mul(radius, radius);
    const VF inverse = hn::Div(set(1.0f), hn::Sqrt(distance2));
    const VF sinSize = hn::Min(hn::Mul(radius, inverse), set(1.0f));
    const VF cosSize = across(sinSize);
    VF cosine = hn::Mul(dot(x, y, z, hn::Load(df, n.axisX + i), hn::Load(df, n.axisY + i),
                            hn::Load(df, n.axisZ + i)),
                        inverse);
    const VF both = hn::Load(df, n.bothSides + i);
    cosine = hn::IfThenElse(hn::Gt(both, hn::Zero(df)), hn::Abs(cosine), cosine);
    VF share = facing(n, i, cosine, cosSize, sinSize);
    if (oneSide) {
      const VF in = hn::Mul(dot(x, y, z, set(-normal.x), set(-normal.y), set(-normal.z)), inverse);
      const VF best = hn::Add(hn::Mul(in, cosSize), hn::Mul(across(in), sinSize));
      share = hn::Mul(
          share, hn::IfThenElse(hn::Lt(in, cosSize), hn::Max(best, set(kLeastBehind)), set(1.0f)));
    }
    const VF outside = hn::Mul(hn::Mul(power, share), hn::Mul(inverse, inverse));
    // Within its own size a light may be anywhere around.
    const VF inside = hn::Div(power, hn::Max(distance2, hn::Mul(radius2, set(0.25f))));
    hn::Store(hn::IfThenElse(hn::Le(distance2, radius2), inside, outside), df, weights + i);
    std::uint8_t bits[8] = {};
    hn::StoreMaskBits(df, hn::Lt(distance2, hn::Mul(radius2, set(kClose * kClose))), bits);
    close |= std::uint32_t(bits[0]) << i;
  }
  return close;
}

WeighLights weighLights() { return weigh; }

}  // namespace HWY_NAMESPACE
}  // namespace trex
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace trex {
HWY_EXPORT(weighLights);
WeighLights chooseWeighLights() {
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return HWY_DYNAMIC_DISPATCH(weighLights)();
}
}  // namespace trex
#endif
