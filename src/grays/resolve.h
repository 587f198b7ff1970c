// From sums of flux to irradiance. Private to src/grays; both tracers share it, so the same sums
// give the same light on every device.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "asvo/asvo.h"

namespace trex {

/// 32-bit words of one array of sums: leaf x side x rgb x (low, high).
inline constexpr std::uint64_t kWordsPerLeaf = 12;

/// What of a tree's voxels decides where flux goes, and stays when their values are edited.
struct TreeFaces {
  struct Leaf {
    float area, back;  ///< m^2, of all faces, and of those against the voxel's normal
  };
  std::vector<Leaf> leaves;
  std::vector<std::uint8_t> flips;  ///< by node: its front is part of its parent's back

  /// By all threads.
  explicit TreeFaces(const asvo::Tree& tree);
};

/// Fills light[] (a node each, asvo_layout.h) from sums of counts of direct and indirect flux, one
/// count being `wattsPerCount`. Sums of flux over sums of area go up the tree, sides exchanged
/// where a child faces against its parent. The area of a side is that of the faces that lie on it,
/// and of the backs of others where light came to a back: the inside of a solid gets none, and must
/// not count where a voxel holds both faces of a wall. Cones take the light over all faces. A voxel
/// side with less than kLeastArea of a leaf's face takes the quotient of its next ancestor that has
/// more, for a small area makes a noisy quotient. Runs on the calling oneTBB arena; same bits for
/// any number of threads and interruptions.
class LightResolver {
 public:
  /// The spans must stay as they are until advance() is done.
  LightResolver(const asvo::Tree& tree, const TreeFaces& faces,
                std::span<const std::uint32_t> direct, std::span<const std::uint32_t> indirect,
                double wattsPerCount, std::span<asvo::uvec4> light);
  ~LightResolver();
  /// Goes on until it is done or `keepGoing` says no, asked between pieces of about a millisecond.
  /// True once done.
  bool advance(const std::function<bool()>& keepGoing);

 private:
  struct Work;
  std::unique_ptr<Work> work_;
};

/// A light array that is resolved in slices while the last one is still read.
class LightBuffers {
 public:
  explicit LightBuffers(std::size_t nodes)
      : front_(nodes, asvo::uvec4(0u)), back_(nodes, asvo::uvec4(0u)) {}
  /// `light`, `before`: a node each, the result at first and that before it.
  LightBuffers(std::vector<asvo::uvec4> light, std::vector<asvo::uvec4> before)
      : front_(std::move(light)), back_(std::move(before)) {}
  /// Before the first resolve(), which else does it.
  void prepare(const asvo::Tree& tree) {
    if (!faces_) faces_.emplace(tree);
  }
  const std::vector<asvo::uvec4>& front() const { return front_; }
  /// The result before, until the next resolve() is called.
  const std::vector<asvo::uvec4>& before() const { return back_; }
  /// Give results away; they keep their addresses.
  std::vector<asvo::uvec4> take() { return std::move(front_); }
  std::vector<asvo::uvec4> takeBefore() { return std::move(back_); }
  /// As LightResolver::advance(); once done front() has the result. A slice under way is forgotten
  /// if the photons differ from the last call's.
  bool resolve(const asvo::Tree& tree, std::span<const std::uint32_t> direct,
               std::span<const std::uint32_t> indirect, double wattsPerCount, std::uint64_t photons,
               const std::function<bool()>& keepGoing);
  /// The sums have changed: what is under way is void.
  void restart() { resolver_.reset(); }

 private:
  std::vector<asvo::uvec4> front_, back_;
  std::optional<TreeFaces> faces_;
  std::unique_ptr<LightResolver> resolver_;
  std::uint64_t photons_ = 0;
};

inline constexpr float kLeastArea = 0.2f;

}  // namespace trex
