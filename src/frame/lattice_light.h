// Light of a coarse frame, brought to all of its pixels by what each of them shows [Kopf et al.,
// SIGGRAPH 2007]: where the light of a surface is known at every second or fourth pixel, its edges
// and its texture are those of every pixel.
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

#include "src/frame/alike.h"
#include "src/frame/features.h"

namespace trex {

/// One such picture under way. One thread at a time may call; the work is done in its oneTBB arena.
class LatticeLight {
 public:
  /// `lattice`: what every step-th pixel of every step-th row of `all` shows most, one surface
  /// each. `light`: its filtered light, row by row, texture included; finite. `all`: what pixels
  /// show, of which every `stride`-th of every `stride`-th row is known and wanted; it must outlive
  /// this, and may learn more meanwhile.
  LatticeLight(const FeatureImage& lattice, const std::vector<vec3>& light, const FeatureImage& all,
               std::uint32_t step, std::uint32_t stride = 1);
  /// As GuessFilter::advance().
  bool advance(const std::function<bool()>& keepGoing);
  /// Row by row, of the pixels that are wanted. Once, after advance() has returned true.
  std::vector<vec3> result() { return std::move(out_); }

 private:
  struct Known {
    Shown shown;
    vec3 light;  ///< without texture
    bool surface;
  };
  Known known(const Feature& f) const;
  vec3 lightOf(Feature f, std::uint32_t x, std::uint32_t y) const;
  vec3 lightAt(std::uint32_t x, std::uint32_t y) const;

  const FeatureImage& all_;
  std::uint32_t step_, stride_, columns_, rows_;
  std::vector<Known> lattice_;
  std::vector<vec3> out_;
  std::uint32_t row_ = 0;
};

}  // namespace trex
