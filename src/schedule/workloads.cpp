#include "src/schedule/workloads.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "src/schedule/random.h"

namespace trex::schedule {
namespace {

using Vector = std::array<double, 3>;

Vector anyDirection(Random& random) {
  const double z = 2.0 * random() - 1.0, phi = 2.0 * std::numbers::pi * random();
  const double r = std::sqrt(std::max(0.0, 1.0 - z * z));
  return {r * std::cos(phi), r * std::sin(phi), z};
}

Vector along(const Vector& from, const Vector& direction, double t) {
  return {from[0] + t * direction[0], from[1] + t * direction[1], from[2] + t * direction[2]};
}

struct Box {
  Vector low{}, high{};
  double volume() const { return (high[0] - low[0]) * (high[1] - low[1]) * (high[2] - low[2]); }
};

/// Cells of a k-d tree of an even depth everywhere.
class Cells {
 public:
  Cells(const RayWorkload& of, Random& random) {
    for (int k = 0; k < 3; ++k) box_.high[static_cast<std::size_t>(k)] = of.sides[k];
    std::vector<Vector> points = pointsOf(random);
    split(box_, points.data(), points.data() + points.size(), of.blocks);
  }
  const Box& box() const { return box_; }
  const std::vector<Box>& cells() const { return cells_; }

  struct Crossing {
    double enter = 0.0, leave = 0.0;
    std::uint32_t cell = 0;
  };
  /// Cells along a ray, in order.
  void cross(const Vector& origin, const Vector& direction, std::vector<Crossing>& out) const {
    out.clear();
    for (std::uint32_t c = 0; c < cells_.size(); ++c) {
      double enter = 0.0, leave = 1e300;
      for (std::size_t k = 0; k < 3; ++k) {
        const double inverse = 1.0 / direction[k];
        const double a = (cells_[c].low[k] - origin[k]) * inverse;
        const double b = (cells_[c].high[k] - origin[k]) * inverse;
        enter = std::max(enter, std::min(a, b));
        leave = std::min(leave, std::max(a, b));
      }
      if (enter < leave) out.push_back({enter, leave, c});
    }
    std::sort(out.begin(), out.end(), [](const Crossing& a, const Crossing& b) {
      return a.enter != b.enter ? a.enter < b.enter : a.cell < b.cell;
    });
  }

 private:
  std::vector<Vector> pointsOf(Random& random) const {
    constexpr int kPoints = 8192, kClumps = 24;
    std::vector<Vector> centres(kClumps), points;
    for (Vector& c : centres) {
      for (std::size_t k = 0; k < 3; ++k) c[k] = random() * box_.high[k];
    }
    for (int i = 0; i < kPoints; ++i) {
      const Vector& centre = centres[random.below(kClumps)];
      Vector p{};
      for (std::size_t k = 0; k < 3; ++k) {
        const double spread = 0.06 * box_.high[k] * (random() + random() + random() - 1.5);
        p[k] = i % 2 ? random() * box_.high[k] : std::clamp(centre[k] + spread, 0.0, box_.high[k]);
      }
      points.push_back(p);
    }
    return points;
  }

  void split(const Box& box, Vector* begin, Vector* end, std::uint32_t leaves) {
    if (leaves < 2) {
      cells_.push_back(box);
      return;
    }
    std::size_t axis = 0;
    for (std::size_t k = 1; k < 3; ++k) {
      if (box.high[k] - box.low[k] > box.high[axis] - box.low[axis]) axis = k;
    }
    Vector* middle = begin + (end - begin) / 2;
    std::nth_element(begin, middle, end,
                     [&](const Vector& a, const Vector& b) { return a[axis] < b[axis]; });
    Box low = box, high = box;
    low.high[axis] = high.low[axis] = (*middle)[axis];
    split(low, begin, middle, leaves / 2);
    split(high, middle, end, leaves / 2);
  }

  Box box_;
  std::vector<Box> cells_;
};

/// Traces what stands for the rays of one picture.
class RayTracer {
 public:
  RayTracer(const RayWorkload& of, Workload& out)
      : of_(of), out_(out), random_(of.seed), cells_(of, random_) {
    const Box& box = cells_.box();
    const Vector to = anyDirection(random_);
    for (std::size_t k = 0; k < 3; ++k) {
      const double middle = 0.5 * box.high[k];
      eye_[k] =
          of.inside ? box.high[k] * (0.2 + 0.6 * random_()) : middle + 1.2 * box.high[k] * to[k];
      light_[k] = middle + (k == 1 ? 2.0 : 0.3) * box.high[k];
    }
  }

  void trace() {
    for (std::uint32_t i = 0; i < of_.walks; ++i) tracePath();
  }

  Random& random() { return random_; }

 private:
  /// Adds the stations of a ray to the way that ends the list; whether it was absorbed, and where.
  bool follow(const Vector& origin, const Vector& direction, double most, std::size_t first,
              Vector& hit) {
    cells_.cross(origin, direction, crossings_);
    for (const Cells::Crossing& c : crossings_) {
      if (c.enter >= most) break;
      if (out_.way.size() == first || out_.way.back() != c.cell) out_.way.push_back(c.cell);
      const double path = of_.freePath * std::cbrt(cells_.cells()[c.cell].volume());
      const double at = c.enter - path * std::log(1.0 - random_());
      if (at >= std::min(c.leave, most)) continue;
      hit = along(origin, direction, at);
      return true;
    }
    return false;
  }

  void tracePath() {
    const Box& box = cells_.box();
    Vector target{}, origin = eye_, direction{}, hit{};
    for (std::size_t k = 0; k < 3; ++k) {
      target[k] = random_() * box.high[k];
      direction[k] = target[k] - eye_[k];
    }
    Walk walk;
    walk.first = static_cast<std::uint32_t>(out_.way.size());
    walk.kind = kTraceRays;
    std::vector<std::pair<std::uint32_t, Vector>> shadows;  // place, origin
    for (std::uint32_t bounce = 0; bounce <= of_.bounces; ++bounce) {
      if (!follow(origin, direction, 1e300, walk.first, hit)) break;
      shadows.emplace_back(static_cast<std::uint32_t>(out_.way.size()) - walk.first - 1, hit);
      if (random_() >= of_.survival) break;
      origin = hit;
      direction = anyDirection(random_);
    }
    walk.length = static_cast<std::uint32_t>(out_.way.size()) - walk.first;
    if (walk.length == 0) return;
    const auto parent = static_cast<std::uint32_t>(out_.walks.size());
    out_.walks.push_back(walk);
    for (const auto& [place, from] : shadows) traceShadow(parent, place, from);
  }

  void traceShadow(std::uint32_t parent, std::uint32_t place, const Vector& from) {
    const Vector direction{light_[0] - from[0], light_[1] - from[1], light_[2] - from[2]};
    const std::uint32_t here = out_.way[out_.walks[parent].first + place];
    Walk walk;
    walk.first = static_cast<std::uint32_t>(out_.way.size());
    walk.parent = parent;
    walk.parentPlace = place;
    walk.kind = kTraceRays;
    Vector hit{};
    follow(from, direction, 1.0, walk.first, hit);
    // The job that found the hit has traced the shadow ray through its own block.
    if (out_.way.size() > walk.first && out_.way[walk.first] == here) {
      out_.way.erase(out_.way.begin() + walk.first);
    }
    walk.length = static_cast<std::uint32_t>(out_.way.size()) - walk.first;
    if (walk.length > 0) out_.walks.push_back(walk);
  }

  const RayWorkload& of_;
  Workload& out_;
  Random random_;
  Cells cells_;
  Vector eye_{}, light_{};
  std::vector<Cells::Crossing> crossings_;
};

/// Sizes that vary by a tenth around an even share.
std::vector<double> sizes(std::uint32_t count, double bytes, Random& random) {
  std::vector<double> out;
  double sum = 0.0;
  for (std::uint32_t i = 0; i < count; ++i) {
    out.push_back(0.9 + 0.2 * random());
    sum += out.back();
  }
  for (double& size : out) size *= bytes / sum;
  return out;
}

}  // namespace

Workload rayWorkload(const RayWorkload& of) {
  Workload w;
  RayTracer tracer(of, w);
  tracer.trace();
  w.itemBytes = sizes(of.blocks, of.bytes, tracer.random());
  for (std::uint32_t b = 0; b < of.blocks; ++b) w.reads.push_back({b});
  w.scratch.assign(of.blocks, 0.0);
  w.unitsPerWalk = of.rays / of.walks;
  w.unitBytes = of.rayBytes;
  return w;
}

RayWorkload boeing777(std::uint32_t blocks, std::uint64_t seed) {
  RayWorkload of;
  of.blocks = blocks;
  of.bytes = 26.5e9;
  of.sides[0] = 3.0;  // fuselage along x, wings along z
  of.sides[2] = 2.5;
  of.freePath = 1.5;
  of.seed = seed;
  return of;
}

RayWorkload sponzaMuseum(std::uint32_t blocks, std::uint64_t seed) {
  RayWorkload of;
  of.blocks = blocks;
  of.bytes = 12.3e9;
  of.sides[0] = 2.0;
  of.inside = true;
  of.freePath = 3.0;  // halls are mostly empty
  of.seed = seed;
  return of;
}

Workload proximityWorkload(std::uint32_t clusters, double bytes, std::uint64_t seed) {
  Random random(seed);
  Workload w;
  w.itemBytes = sizes(2 * clusters, 0.2 * bytes, random);  // hierarchies
  const std::vector<double> triangles = sizes(2 * clusters, 0.8 * bytes, random);
  w.itemBytes.insert(w.itemBytes.end(), triangles.begin(), triangles.end());
  w.unitsPerWalk = 10000.0;
  w.unitBytes = 8.0;
  for (std::uint32_t a = 0; a < clusters; ++a) {
    for (std::uint32_t near = 0; near < 3; ++near) {
      const std::uint32_t b = clusters + (a + near) % clusters;
      w.reads.push_back({a, b});
      w.reads.push_back({2 * clusters + a, 2 * clusters + b});
      w.scratch.insert(w.scratch.end(), {0.0, 64e6});
      const auto station = static_cast<std::uint32_t>(w.reads.size()) - 2;
      const std::uint32_t walks = 20 + random.below(80);
      for (std::uint32_t k = 0; k < walks; ++k) {
        const auto parent = static_cast<std::uint32_t>(w.walks.size());
        const auto at = static_cast<std::uint32_t>(w.way.size());
        w.way.push_back(station);
        w.walks.push_back({at, 1, kNoWalk, 0, kTraverse});
        if (random() >= 0.4) continue;  // most pairs of nodes are apart
        w.way.push_back(station + 1);
        w.walks.push_back({at + 1, 1, parent, 0, kTestPairs});
      }
    }
  }
  return w;
}

Workload particleWorkload(std::uint32_t blocks, double bytes, std::uint64_t seed) {
  constexpr std::uint32_t kSteps = 3, kGroups = 50;
  Random random(seed);
  Workload w;
  w.itemBytes = sizes(blocks, bytes, random);
  w.unitsPerWalk = 20000.0;
  w.unitBytes = 32.0;
  for (std::uint32_t b = 0; b < blocks; ++b) {
    w.reads.push_back({b});
    w.scratch.push_back(3.0 * w.itemBytes[b]);
    for (std::uint32_t g = 0; g < kGroups; ++g) {
      Walk walk;
      walk.first = static_cast<std::uint32_t>(w.way.size());
      walk.kind = kFindNeighbours;
      walk.length = kSteps;
      std::uint32_t at = b;
      for (std::uint32_t step = 0; step < kSteps; ++step) {
        w.way.push_back(at);
        if (random() < 0.1) at = (at + (random() < 0.5 ? 1 : blocks - 1)) % blocks;
      }
      w.walks.push_back(walk);
    }
  }
  return w;
}

}  // namespace trex::schedule
