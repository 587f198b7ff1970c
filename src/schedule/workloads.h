// Workloads for the simulator: rays in blocks of a model, and two others that show that a kind of
// job is only a number. Each is a pure function of its description.
#pragma once

#include <cstdint>

#include "src/schedule/walks.h"

namespace trex::schedule {

/// Kinds of job that machines.h has rates of.
enum Kind : std::uint32_t {
  kTraceRays,       ///< unit: a ray in one block
  kTraverse,        ///< unit: a pair of nodes of two hierarchies
  kTestPairs,       ///< unit: a pair of triangles
  kFindNeighbours,  ///< unit: a particle
  kKinds
};

/// Light transport through a model that was cut into blocks.
///   Blocks: cells of a k-d tree that halves points of the model, half of them spread evenly in its
/// box, half in clumps, at the median of the longest side. Sizes vary by a tenth.
///   Rays: start at the eye, cross cells in order, and are absorbed in a cell with probability
/// 1 - exp(-chord / (freePath * cube root of its volume)). From there a shadow ray goes to a light
/// above the model, and with probability `survival` the path goes on in any direction, `bounces`
/// times at most. A ray that goes on in the block where it was is served by the same job.
struct RayWorkload {
  std::uint32_t blocks = 128;  ///< a power of two
  double bytes = 0.0;          ///< of all blocks
  double sides[3] = {1.0, 1.0, 1.0};
  bool inside = false;  ///< the eye is inside of the model
  double freePath = 1.5;
  double survival = 0.6;
  std::uint32_t bounces = 4;
  double rays = 800.0 * 800.0 * 32.0;  ///< from the eye
  double rayBytes = 48.0;              ///< origin, direction, throughput, pixel, state
  std::uint32_t walks = 20480;         ///< that stand for them
  std::uint64_t seed = 1;
};
Workload rayWorkload(const RayWorkload& of);

/// The two models of HPG 2017. `blocks`: 128 or 64.
RayWorkload boeing777(std::uint32_t blocks, std::uint64_t seed);     ///< 26.5 GB
RayWorkload sponzaMuseum(std::uint32_t blocks, std::uint64_t seed);  ///< 12.3 GB

/// Proximity queries between two models [Kim et al., TVCG 2013]: hierarchies of two clusters are
/// traversed together (two items), pairs of triangles that are left are tested (two larger items,
/// and room for results).
Workload proximityWorkload(std::uint32_t clusters, double bytes, std::uint64_t seed);

/// Neighbours of particles of a fluid on a grid of blocks, several steps [Kim et al., HPG 2014]: a
/// block is read with its halo, and lists of neighbours are as large as several blocks.
Workload particleWorkload(std::uint32_t blocks, double bytes, std::uint64_t seed);

}  // namespace trex::schedule
