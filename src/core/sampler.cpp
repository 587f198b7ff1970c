// Eight dimensions at once, a lane each. Compiled once for each instruction set [Highway's
// foreach_target].
#include "src/core/sampler.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/core/sampler.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#ifndef TREX_SAMPLER_ONCE
#define TREX_SAMPLER_ONCE
namespace trex {
namespace {

constexpr std::uint32_t kOwenFactors[3] = {0x3d20adeau, 0x05526c56u, 0x53a22864u};
/// What makes of a dimension's key those of its two numbers.
constexpr std::uint32_t kFirstKey = 0x5bd1e995u, kSecondKey = 0xc2b2ae35u;

}  // namespace
}  // namespace trex
#endif

HWY_BEFORE_NAMESPACE();
namespace trex {
namespace HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

using DU = hn::CappedTag<std::uint32_t, Sampler::kBlock>;
using VU = hn::Vec<DU>;
constexpr std::size_t kWidth = hn::MaxLanes(DU());
static_assert(Sampler::kBlock % kWidth == 0);

template <typename V>
HWY_INLINE V setAs(std::uint32_t value) {
  return hn::Set(hn::DFromV<V>(), value);
}
template <int kShift, typename V>
HWY_INLINE V xorShift(V x) {
  return hn::Xor(x, hn::ShiftRight<kShift>(x));
}

template <typename V>
HWY_INLINE V hash(V x) {
  x = hn::Mul(xorShift<16>(x), setAs<V>(kHashFactors[0]));
  x = hn::Mul(xorShift<15>(x), setAs<V>(kHashFactors[1]));
  return xorShift<15>(x);
}

/// Bits of nibbles by a table, then the nibbles and the bytes change places.
template <typename V>
HWY_INLINE V reverse(V x) {
  const hn::DFromV<V> du;
  const hn::Repartition<std::uint8_t, hn::DFromV<V>> db;
  alignas(16) static constexpr std::uint8_t kLow[16] = {0, 8, 4, 12, 2, 10, 6, 14,
                                                        1, 9, 5, 13, 3, 11, 7, 15};
  alignas(16) static constexpr std::uint8_t kHigh[16] = {0,  128, 64, 192, 32, 160, 96,  224,
                                                         16, 144, 80, 208, 48, 176, 112, 240};
  alignas(16) static constexpr std::uint8_t kBytes[16] = {3,  2,  1, 0, 7,  6,  5,  4,
                                                          11, 10, 9, 8, 15, 14, 13, 12};
  const V mask = setAs<V>(0x0f0f0f0fu);
  const auto low = hn::BitCast(db, hn::And(x, mask));
  const auto high = hn::BitCast(db, hn::And(hn::ShiftRight<4>(x), mask));
  const auto swapped = hn::Or(hn::TableLookupBytes(hn::LoadDup128(db, kHigh), low),
                              hn::TableLookupBytes(hn::LoadDup128(db, kLow), high));
  return hn::BitCast(du, hn::TableLookupBytes(swapped, hn::LoadDup128(db, kBytes)));
}

/// Owen scrambling in base 2 of a value with its bits reversed, by a Laine-Karras style
/// permutation.
template <typename V>
HWY_INLINE V scramble(V x, V seed) {
  x = hn::Xor(x, hn::Mul(x, setAs<V>(kOwenFactors[0])));
  x = hn::Add(x, seed);
  x = hn::Mul(x, hn::Or(hn::ShiftRight<16>(seed), setAs<V>(1)));
  x = hn::Xor(x, hn::Mul(x, setAs<V>(kOwenFactors[1])));
  x = hn::Xor(x, hn::Mul(x, setAs<V>(kOwenFactors[2])));
  return reverse(x);
}

template <int kShift>
HWY_INLINE VU superset(VU x, std::uint32_t mask) {
  return hn::Xor(x, hn::And(hn::ShiftRight<kShift>(x), setAs<VU>(mask)));
}
/// Second Sobol' dimension of an index with its bits reversed (so the first is the index itself).
/// Its matrix is Pascal's triangle mod 2: by Lucas' theorem digit i is the sum of all index bits j
/// that contain i, a superset transform.
HWY_INLINE VU second(VU x) {
  x = superset<1>(x, 0x55555555u);
  x = superset<2>(x, 0x33333333u);
  x = superset<4>(x, 0x0f0f0f0fu);
  x = superset<8>(x, 0x00ff00ffu);
  return hn::Xor(x, hn::ShiftRight<16>(x));
}

template <typename V>
HWY_INLINE auto toUnit(V bits) {
  const hn::Rebind<float, hn::DFromV<V>> df;
  const hn::Rebind<std::int32_t, hn::DFromV<V>> di;
  const auto whole = hn::ConvertTo(df, hn::BitCast(di, hn::ShiftRight<8>(bits)));
  return hn::Mul(whole, hn::Set(df, 0x1p-24f));
}

/// Both numbers of kWidth dimensions: in one vector where registers are wide enough.
HWY_INLINE void drawAt(VU key, VU sample, float* x, float* y) {
  const hn::Rebind<float, DU> df;
  const VU index = scramble(sample, key);
  const VU seedX = hn::Xor(key, setAs<VU>(kFirstKey)), seedY = hn::Xor(key, setAs<VU>(kSecondKey));
#if HWY_TARGET <= HWY_AVX3 && HWY_ARCH_X86_64
  const hn::Twice<DU> both;
  const auto unit = toUnit(
      scramble(hn::Combine(both, second(index), index), hash(hn::Combine(both, seedY, seedX))));
  hn::Store(hn::LowerHalf(df, unit), df, x);
  hn::Store(hn::UpperHalf(df, unit), df, y);
#else
  hn::Store(toUnit(scramble(index, hash(seedX))), df, x);
  hn::Store(toUnit(scramble(second(index), hash(seedY))), df, y);
#endif
}

void draw(const Sampler::State& from, float* x, float* y) {
  const DU du;
  const VU spread = setAs<VU>((from.key << 6) + (from.key >> 2) + 0x9e3779b9u);
  for (std::uint32_t i = 0; i < Sampler::kBlock; i += kWidth) {
    const VU dimension = hn::Iota(du, from.dimension + i);
    const VU key = hash(hn::Xor(setAs<VU>(from.key), hn::Add(dimension, spread)));
    drawAt(key, setAs<VU>(from.sample), x + i, y + i);
  }
}

}  // namespace HWY_NAMESPACE
}  // namespace trex
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace trex {
HWY_EXPORT(draw);

std::uint32_t Sampler::refill() {
  first_ = state_.dimension - 1;
  HWY_DYNAMIC_DISPATCH(draw)({state_.key, state_.sample, first_}, x_, y_);
  return 0;
}
}  // namespace trex
#endif
