// The C++ build of shaders/photon.h. Private to src/grays.
#pragma once

#include <atomic>
#include <bit>
#include <cmath>
#include <span>

#include "src/grays/grid_tracer.h"
#include "src/grays/shaderio.h"

namespace trex::photon {

using asvo::uint;
using glm::inversesqrt;
using glm::max;
using glm::min;
using glm::uvec3;
using glm::vec3;
using shaderio::kLastLanding;
using shaderio::kLaterLanding;
using shaderio::kMostPhotonBounces;
using shaderio::kPhotonNumbers;
using shaderio::PhotonMaterial;
using shaderio::PhotonRecord;
using std::abs;
using std::cos;
using std::floor;
using std::sin;
using std::sqrt;

#define RANDOM_FN inline
#include "shaders/random.h"

/// Traces photons through a tree into sums of counts, one 64-bit word for each side and channel
/// (leaf * 6 + side * 3 + channel). Thread safe: additions are atomic.
class Photons : public GridTracer {
 public:
  static constexpr uint ASVO_NONE = asvo::ASVO_NONE;

  Photons(const GridTracer& tracer, std::span<const PhotonMaterial> materials,
          std::span<std::uint64_t> direct, std::span<std::uint64_t> indirect)
      : GridTracer(tracer), materials_(materials), direct_(direct), indirect_(indirect) {}

  static void add(std::uint64_t& sum, uint low, uint high) {
    std::atomic_ref<std::uint64_t>(sum).fetch_add(low | std::uint64_t{high} << 32,
                                                  std::memory_order_relaxed);
  }

#define ASVO_INFO info_
#define PHOTON_MATERIAL(i) materials_[i]
#define PHOTON_MATERIAL_COUNT static_cast<uint>(materials_.size())
#define PHOTON_ADD_DIRECT(i, lo, hi) add(direct_[i], lo, hi)
#define PHOTON_ADD_INDIRECT(i, lo, hi) add(indirect_[i], lo, hi)
#include "shaders/photon.h"
#undef ASVO_INFO
#undef PHOTON_MATERIAL
#undef PHOTON_MATERIAL_COUNT
#undef PHOTON_ADD_DIRECT
#undef PHOTON_ADD_INDIRECT

 private:
  std::span<const PhotonMaterial> materials_;
  std::span<std::uint64_t> direct_, indirect_;
};

}  // namespace trex::photon
