#include "src/bench/photon_map.h"

#include <algorithm>
#include <nanoflann.hpp>
#include <vector>

namespace trex {
namespace {

struct Photon {
  vec3 position, normal, power;
};

/// As nanoflann reads points.
struct Cloud {
  std::vector<Photon> photons;
  std::size_t kdtree_get_point_count() const { return photons.size(); }
  float kdtree_get_pt(std::size_t i, std::size_t axis) const {
    return photons[i].position[static_cast<int>(axis)];
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

using Index = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<float, Cloud>, Cloud,
                                                  3, std::uint32_t>;
constexpr std::size_t kLeafPhotons = 10;  // below a node, nanoflann's default
constexpr float kSameSide = 0.5f;         // cosine

}  // namespace

struct PhotonMap::Tree {
  Cloud cloud;
  Index index;
  explicit Tree(Cloud points)
      : cloud(std::move(points)),
        index(3, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(kLeafPhotons)) {
    index.buildIndex();
  }
};

PhotonMap::PhotonMap(std::span<const LandedPhoton> landed, std::uint64_t emitted,
                     std::size_t nearest)
    : nearest_(nearest) {
  Cloud cloud;
  cloud.photons.reserve(landed.size());
  const float share = 1.0f / static_cast<float>(std::max<std::uint64_t>(emitted, 1));
  for (const LandedPhoton& p : landed)
    if (p.held) cloud.photons.push_back({p.position, p.normal, p.power * share});
  tree_ = std::make_unique<Tree>(std::move(cloud));
  if (landed.empty()) return;
  Box3f bounds;
  std::uint32_t most = 0;
  for (const LandedPhoton& p : landed) {
    bounds.extend(p.position);
    most = std::max(most, p.turns);
  }
  TurnSums sums(bounds, most);
  for (const LandedPhoton& p : landed)
    if (p.held) sums.add(p.position, p.turns, p.power.x + p.power.y + p.power.z);
  turns_ = sums.shares();
}

PhotonMap::~PhotonMap() = default;

std::size_t PhotonMap::photons() const { return tree_->cloud.photons.size(); }

std::size_t PhotonMap::bytes() const {
  return photons() * sizeof(Photon) + tree_->index.usedMemory(tree_->index);
}

bool PhotonMap::irradiance(const vec3& position, const vec3& normal, float /*radius*/,
                           vec2 /*jitter*/, vec3& out) const {
  thread_local std::vector<std::uint32_t> found;
  thread_local std::vector<float> squares;
  found.resize(nearest_);
  squares.resize(nearest_);
  const std::size_t count =
      tree_->index.knnSearch(&position.x, nearest_, found.data(), squares.data());
  if (count == 0) return false;
  vec3 power(0.0f);
  for (std::size_t i = 0; i < count; ++i) {
    const Photon& p = tree_->cloud.photons[found[i]];
    if (glm::dot(p.normal, normal) > kSameSide) power += p.power;
  }
  const float area = kPi * squares[count - 1];
  if (!(area > 0.0f)) return false;
  out = power / area;
  return true;
}

}  // namespace trex
