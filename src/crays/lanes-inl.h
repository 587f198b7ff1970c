// Vectors of doubles, and of as many floats, for one instruction set: included by files that
// Highway compiles once for each. All operations are exactly rounded, none is fused; functions have
// the names and the order of operations of GLM's, so that they have its bits.
#if defined(TREX_LANES_INL) == defined(HWY_TARGET_TOGGLE)
#ifdef TREX_LANES_INL
#undef TREX_LANES_INL
#else
#define TREX_LANES_INL
#endif

#include <hwy/highway.h>

HWY_BEFORE_NAMESPACE();
namespace trex {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using DD = hn::CappedTag<double, 8>;
using DF = hn::Rebind<float, DD>;
using VD = hn::Vec<DD>;
using VF = hn::Vec<DF>;
using MD = hn::Mask<DD>;
using MF = hn::Mask<DF>;
constexpr std::size_t kWidth = hn::MaxLanes(DD());

HWY_INLINE VF set(float x) { return hn::Set(DF(), x); }
HWY_INLINE VD set(double x) { return hn::Set(DD(), x); }
HWY_INLINE VF load(const float* from) { return hn::LoadU(DF(), from); }
HWY_INLINE VD load(const double* from) { return hn::LoadU(DD(), from); }
HWY_INLINE void store(VF x, float* to) { hn::StoreU(x, DF(), to); }
HWY_INLINE void store(VD x, double* to) { hn::StoreU(x, DD(), to); }
HWY_INLINE VD widen(VF x) { return hn::PromoteTo(DD(), x); }
HWY_INLINE VF narrow(VD x) { return hn::DemoteTo(DF(), x); }
template <typename M, typename V>
HWY_INLINE V select(M mask, V yes, V no) {
  return hn::IfThenElse(mask, yes, no);
}
// std::min and std::max, of equals and of what is no number too.
template <typename V>
HWY_INLINE V least(V a, V b) {
  return hn::IfThenElse(hn::Lt(b, a), b, a);
}
template <typename V>
HWY_INLINE V most(V a, V b) {
  return hn::IfThenElse(hn::Lt(a, b), b, a);
}
HWY_INLINE MF maskF(std::uint32_t bits, std::size_t first) {
  const std::uint8_t bytes[8] = {static_cast<std::uint8_t>(bits >> first)};
  return hn::LoadMaskBits(DF(), bytes);
}
HWY_INLINE MD maskD(std::uint32_t bits, std::size_t first) {
  const std::uint8_t bytes[8] = {static_cast<std::uint8_t>(bits >> first)};
  return hn::LoadMaskBits(DD(), bytes);
}
template <typename D, typename M>
HWY_INLINE std::uint32_t bitsOf(D d, M mask, std::size_t first) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(d, mask, bytes);
  return (std::uint32_t(bytes[0]) & ((1u << kWidth) - 1u)) << first;
}
HWY_INLINE std::uint32_t bits(MF mask, std::size_t first) { return bitsOf(DF(), mask, first); }

template <typename V>
struct Vec3 {
  V x, y, z;
};
using VF3 = Vec3<VF>;
using VD3 = Vec3<VD>;

template <typename V>
HWY_INLINE Vec3<V> operator+(const Vec3<V>& a, const Vec3<V>& b) {
  return {a.x + b.x, a.y + b.y, a.z + b.z};
}
template <typename V>
HWY_INLINE Vec3<V> operator-(const Vec3<V>& a, const Vec3<V>& b) {
  return {a.x - b.x, a.y - b.y, a.z - b.z};
}
template <typename V>
HWY_INLINE Vec3<V> operator*(const Vec3<V>& a, V b) {
  return {a.x * b, a.y * b, a.z * b};
}
template <typename V>
HWY_INLINE Vec3<V> operator/(const Vec3<V>& a, V b) {
  return {a.x / b, a.y / b, a.z / b};
}
template <typename V>
HWY_INLINE Vec3<V> negative(const Vec3<V>& a) {
  return {hn::Neg(a.x), hn::Neg(a.y), hn::Neg(a.z)};
}
template <typename M, typename V>
HWY_INLINE Vec3<V> select(M mask, const Vec3<V>& yes, const Vec3<V>& no) {
  return {select(mask, yes.x, no.x), select(mask, yes.y, no.y), select(mask, yes.z, no.z)};
}
template <typename V>
HWY_INLINE V dot(const Vec3<V>& a, const Vec3<V>& b) {
  return a.x * b.x + a.y * b.y + a.z * b.z;
}
template <typename V>
HWY_INLINE Vec3<V> cross(const Vec3<V>& a, const Vec3<V>& b) {
  return {a.y * b.z - b.y * a.z, a.z * b.x - b.z * a.x, a.x * b.y - b.x * a.y};
}
HWY_INLINE VF3 normalize(const VF3& a) { return a * (set(1.0f) / hn::Sqrt(dot(a, a))); }
HWY_INLINE VD3 widen(const VF3& a) { return {widen(a.x), widen(a.y), widen(a.z)}; }
HWY_INLINE VF3 narrow(const VD3& a) { return {narrow(a.x), narrow(a.y), narrow(a.z)}; }

template <typename T, std::size_t kCount>
HWY_INLINE auto load(const T (&from)[3][kCount], std::size_t first) {
  return Vec3<decltype(load(from[0]))>{load(from[0] + first), load(from[1] + first),
                                       load(from[2] + first)};
}
template <typename V, typename T, std::size_t kCount>
HWY_INLINE void store(const Vec3<V>& a, T (&to)[3][kCount], std::size_t first) {
  store(a.x, to[0] + first), store(a.y, to[1] + first), store(a.z, to[2] + first);
}

}  // namespace HWY_NAMESPACE
}  // namespace trex
HWY_AFTER_NAMESPACE();

#endif
