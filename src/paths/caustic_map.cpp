#include <algorithm>
#include <bit>
#include <cmath>
#include <numbers>
#include <utility>

#include "src/paths/caustics.h"
#include "src/paths/walk_tracer.h"

namespace trex {
namespace {

constexpr float kSameFacing = 0.7f;  // cosine of normals from which on photons lie on one surface
constexpr float kOffPlane = 0.3f;    // of the radius: farther off the tangent plane is another one
constexpr float kWidest = 0.1f;      // of the scene's radius
/// Radii over the way from where light was bent last: it does not stay the same along a surface for
/// much longer than that (what lands beneath a chair's tube is not seen beside it).
constexpr float kOfWay = 2.0f;
constexpr float kGrazing = 1e-3f;  // cosine

/// Epanechnikov's, over a disk.
float kernel(float distance2, float radius) {
  const float square = radius * radius;
  return 2.0f * kInvPi * std::max(0.0f, 1.0f - distance2 / square) / square;
}

/// Whether light of a photon may be taken at a point of a surface.
bool sameSurface(const CausticPhoton& photon, const vec3& point, const vec3& normal, float radius) {
  return std::abs(glm::dot(photon.normal, normal)) >= kSameFacing &&
         std::abs(glm::dot(photon.position - point, normal)) <= kOffPlane * radius;
}

/// What a photon's disk is: how wide, and what the photon's power takes so that nothing is lost
/// beyond edges.
struct Spot {
  std::uint32_t level = 0;
  float gain = 1.0f;
};

/// A probe looks along the normal at a random point of a photon's disk: what its kernel brings
/// there to the surface that it sees, over what it would bring to a plane. Nothing beyond an edge,
/// nor on a tube of metal that lies in the disk, nor where alpha lets it through.
///
/// First probes halve a disk until one finds something. Then the gain is 1 over the share s of the
/// kernel that finds surfaces. Of n points in it and one more that does, n + 1 over those that do
/// is (1 - (1 - s)^(n + 1)) / s on average; how many more are wanted until one does, where n + 1 do
/// not, is the rest.
struct Probe : Walk {
  enum class Asks : std::uint8_t { kNarrower, kShare, kOne, kHowMany };
  Asks asks = Asks::kNarrower;
  int points = 0;       ///< of kShare and kHowMany, so far
  float sum = 1.0f;     ///< what they brought
  float radius = 0.0f;  ///< of the disk
  float away = 0.0f;    ///< of the point, from the photon
  int layers = 0;       ///< that the probe has passed
};

struct Probes {
  using State = Probe;
  static constexpr bool kAnyHit = false;
  using Found = FindsNothing;
  static constexpr int kLayers = 8, kPoints = 3, kMostPoints = 64;

  const Scene& scene;
  std::span<const CausticPhoton> photons;
  const CausticWidths& widths;
  float shrink;
  std::vector<Spot>& spots;  ///< by photon

  Sampler sampler(std::uint32_t walk) const { return Sampler(0x73706f74u, walk, 0); }
  bool begin(Probe& walk, Sampler& sampler) const;
  void await(const Surface& surface) const { prefetchTextures(scene, surface); }
  bool advance(Probe& walk, Sampler& sampler, const WalkEnd& end,
               WalkFindings<FindsNothing>&) const;

 private:
  void look(Probe& walk, Sampler& sampler) const;
  bool near(const Probe& walk, const Surface& surface) const;
  float brings(const Probe& walk, Sampler& sampler, const Surface& surface) const;
  bool goesOn(Probe& walk, float brings) const;
};

bool Probes::begin(Probe& walk, Sampler& sampler) const {
  Spot& spot = spots[walk.number];
  const CausticPhoton& photon = photons[walk.number];
  spot.level =
      std::min(widths.level(photon, sampler.next2D()), widths.levelWithin(kOfWay * photon.way));
  if (spot.level == 0) walk.asks = Probe::Asks::kShare;
  look(walk, sampler);
  return true;
}

/// A new probe.
void Probes::look(Probe& walk, Sampler& sampler) const {
  const CausticPhoton& photon = photons[walk.number];
  walk.radius = widths.radius(spots[walk.number].level) * shrink;
  const Basis basis(photon.normal);
  // Of the kernel's density: 1 - (1 - (r / radius)^2)^2 is uniform.
  const vec2 u = sampler.next2D();
  walk.away = walk.radius * std::sqrt(1.0f - std::sqrt(1.0f - u.x));
  const float phi = 2.0f * kPi * u.y;
  const vec3 aside = walk.away * (std::cos(phi) * basis.tangent + std::sin(phi) * basis.bitangent);
  const vec3 up = glm::dot(photon.towards, photon.normal) < 0.0f ? -photon.normal : photon.normal;
  const float height = 1.5f * kOffPlane * walk.radius;
  walk.start = dvec3(photon.position + aside + height * up);
  walk.direction = -up;
  walk.end = 2.0f * height;
  walk.layers = 0;
}

bool Probes::advance(Probe& walk, Sampler& sampler, const WalkEnd& end,
                     WalkFindings<FindsNothing>&) const {
  float brought = 0.0f;
  if (end.met() && !near(walk, end.surface)) {
    walk.start = end.surface.leave();
    walk.end -= end.distance;
    if (++walk.layers < kLayers) return true;
  } else if (end.met()) {
    brought = brings(walk, sampler, end.surface);
  }
  if (!goesOn(walk, brought)) return false;
  look(walk, sampler);
  return true;
}

/// Whether a surface is where light of the photon may be; what lies farther down is in its shade.
bool Probes::near(const Probe& walk, const Surface& surface) const {
  const CausticPhoton& photon = photons[walk.number];
  const vec3 off = vec3(surface.position) - photon.position;
  return std::abs(glm::dot(off, photon.normal)) <= kOffPlane * walk.radius;
}

/// What the kernel brings to that surface: nothing where photons of its light would not land.
float Probes::brings(const Probe& walk, Sampler& sampler, const Surface& surface) const {
  const CausticPhoton& photon = photons[walk.number];
  const vec3 point(surface.position), off = point - photon.position;
  const vec3& normal = surface.geometricNormal;
  if (!sameSurface(photon, point, normal, walk.radius)) return 0.0f;
  if (glm::dot(normal, walk.direction) * glm::dot(normal, photon.towards) >= 0.0f) return 0.0f;
  const Bsdf bsdf(scene, surface, -walk.direction);
  if (bsdf.unlit() || !landsOn(bsdf, photon.blurred)) return 0.0f;
  // A narrower disk would be let through as often.
  const float coverage = walk.asks == Probe::Asks::kNarrower ? 1.0f : bsdf.coverage();
  if (coverage < 1.0f && sampler.next1D() >= coverage) return 0.0f;
  const float cosine = std::abs(glm::dot(normal, photon.normal));
  return kernel(glm::dot(off, off), walk.radius) /
         (kernel(walk.away * walk.away, walk.radius) * cosine);
}

/// Whether another probe is wanted, and for what.
bool Probes::goesOn(Probe& walk, float brings) const {
  Spot& spot = spots[walk.number];
  switch (walk.asks) {
    case Probe::Asks::kNarrower:
      if (!(brings <= 0.0f) || --spot.level == 0) walk.asks = Probe::Asks::kShare;
      return true;
    case Probe::Asks::kShare:
      walk.sum += brings;
      if (++walk.points < kPoints) return true;
      spot.gain = (kPoints + 1) / walk.sum;
      walk.asks = Probe::Asks::kOne;
      return !(walk.sum > 1.0f);
    case Probe::Asks::kOne:
      if (brings > 0.0f) return false;
      walk.asks = Probe::Asks::kHowMany;
      walk.points = 0;
      break;
    case Probe::Asks::kHowMany:
      if (brings > 0.0f || ++walk.points == kMostPoints) return false;
      break;
  }
  spot.gain += 1.0f;
  return true;
}

}  // namespace

CausticWidths::CausticWidths(std::span<const CausticPhoton> photons, float scene, double wanted)
    : scene_(scene), wanted_(wanted) {
  // Cells of a level lie in those of the next: where none has enough, none of the finer ones has.
  bool enough = true;
  for (std::uint32_t level = kLevels - 1; level-- > 0 && enough;) {
    enough = false;
    for (const CausticPhoton& p : photons) {
      enough |= ++counts_[level][key(p.position, level)] >= leastInCell();
    }
  }
}

float CausticWidths::radius(std::uint32_t level) const {
  return kWidest * scene_ * std::exp2(static_cast<float>(level) - (kLevels - 1.0f));
}

/// Of the cell, two radii wide, that a place lies in.
std::uint64_t CausticWidths::key(const vec3& position, std::uint32_t level) const {
  const vec3 cell = glm::floor(position / (2.0f * radius(level)));
  std::uint64_t key = 0;
  for (int axis = 0; axis < 3; ++axis) {
    key =
        key << 21 | (static_cast<std::uint64_t>(static_cast<std::int64_t>(cell[axis])) & 0x1fffffu);
  }
  return key;
}

std::uint32_t CausticWidths::level(const CausticPhoton& photon, vec2 u) const {
  const Basis basis(photon.normal);
  const vec3 aside = basis.tangent * (2.0f * u.x - 1.0f) + basis.bitangent * (2.0f * u.y - 1.0f);
  for (std::uint32_t level = 0; level + 1 < kLevels; ++level) {
    const auto at = counts_[level].find(key(photon.position + radius(level) * aside, level));
    if (at != counts_[level].end() && at->second >= leastInCell()) return level;
  }
  return kLevels - 1;
}

std::uint32_t CausticWidths::levelWithin(float most) const {
  std::uint32_t level = kLevels - 1;
  while (level > 0 && radius(level) > most) --level;
  return level;
}

CausticMap::CausticMap(const Scene& scene, std::span<const CausticPhoton> photons,
                       const CausticWidths& widths, float shrink, const WalkTracer& walks) {
  std::vector<Spot> spots(photons.size());
  const Probes probes{scene, photons, widths, shrink, spots};
  walks.follow(probes, static_cast<std::uint32_t>(photons.size()));
  std::array<std::vector<CausticPhoton>, CausticWidths::kLevels> byLevel;
  for (std::size_t i = 0; i < photons.size(); ++i) {
    byLevel[spots[i].level].push_back(photons[i]);
    byLevel[spots[i].level].back().power *= spots[i].gain;
  }
  std::size_t finer = 0;
  for (std::uint32_t level = 0; level < CausticWidths::kLevels; ++level) {
    if (byLevel[level].empty()) continue;
    grids_.emplace_back(level, std::move(byLevel[level]), widths.radius(level) * shrink, finer);
    finer += grids_.back().photons.size();
  }
  for (std::size_t i = 1; i < grids_.size(); ++i) {
    for (std::size_t fine = 0; fine < i; ++fine) grids_[i].markFiner(grids_[fine]);
  }
}

std::size_t CausticMap::size() const {
  std::size_t sum = 0;
  for (const Grid& grid : grids_) sum += grid.photons.size();
  return sum;
}

CausticMap::Grid::Grid(std::uint32_t number, std::vector<CausticPhoton> all, float width,
                       std::size_t finer)
    : level(number), radius(width), photons(std::move(all)) {
  std::vector<std::pair<std::size_t, Entry>> placed;
  std::size_t buckets = 1, most = 1;
  while (buckets < 2 * photons.size()) buckets *= 2;
  while (most < 2 * photons.size() + finer) most *= 2;
  firsts.assign(buckets + 1, 0);
  marks.assign((most * kMarksOfBucket + 31) / 32, 0);
  for (std::uint32_t i = 0; i < photons.size(); ++i) {
    const vec3& p = photons[i].position;
    forReached(p, *this, [&](const glm::ivec3& c) {
      placed.emplace_back(hash(c) & (buckets - 1), Entry{p, i << 3 | parity(c)});
      ++firsts[placed.back().first + 1];
      mark(c, kHere);
    });
  }
  for (std::size_t i = 1; i <= buckets; ++i) firsts[i] += firsts[i - 1];
  std::vector<std::uint32_t> next(firsts.begin(), firsts.end() - 1);
  entries.resize(placed.size());
  for (const auto& [at, entry] : placed) entries[next[at]++] = entry;
}

/// Cells of this grid that hold what disks of a finer one, or of its own, may reach.
template <typename Use>
void CausticMap::Grid::forReached(const vec3& position, const Grid& finer, const Use& use) const {
  const auto up = static_cast<int>(level - finer.level);
  glm::ivec3 lower = finer.cell(position - finer.radius),
             upper = glm::min(finer.cell(position + finer.radius), lower + 1);
  lower >>= up, upper >>= up;
  for (glm::ivec3 c = lower; c.z <= upper.z; ++c.z) {
    for (c.y = lower.y; c.y <= upper.y; ++c.y) {
      for (c.x = lower.x; c.x <= upper.x; ++c.x) use(c);
    }
  }
}

void CausticMap::Grid::markFiner(const Grid& finer) {
  for (const CausticPhoton& p : finer.photons) {
    forReached(p.position, finer, [&](const glm::ivec3& c) { mark(c, kFiner); });
  }
}

void CausticMap::Grid::mark(const glm::ivec3& c, std::uint32_t what) {
  const std::size_t at = place(c);
  marks[at / 32] |= std::uint64_t{what} << 2 * (at % 32);
}

std::uint32_t CausticMap::Grid::marked(const glm::ivec3& c) const {
  const std::size_t at = place(c);
  return static_cast<std::uint32_t>(marks[at / 32] >> 2 * (at % 32)) & 3u;
}

glm::ivec3 CausticMap::Grid::cell(const vec3& position) const {
  constexpr float kMost = 1e9f;  // so that it fits an integer
  const vec3 at = glm::clamp(position / (2.0f * radius), vec3(-kMost), vec3(kMost));
  const glm::ivec3 towardsZero(at);
  return towardsZero - glm::ivec3(glm::lessThan(at, vec3(towardsZero)));
}

std::uint32_t CausticMap::Grid::hash(const glm::ivec3& c) {
  const glm::uvec3 u(c);
  const std::uint32_t key =
      (u.x * 0x9e3779b1u ^ u.y * 0x85ebca77u ^ u.z * 0xc2b2ae3du) * 0x27d4eb2fu;
  return key ^ key >> 15;
}

/// Calls use(photon, distance^2) for all within the radius.
template <typename Use>
void CausticMap::Grid::forNear(const vec3& position, const Use& use) const {
  const glm::ivec3 here = cell(position);
  const std::size_t b = hash(here) & (firsts.size() - 2);
  for (std::uint32_t i = firsts[b]; i < firsts[b + 1]; ++i) {
    const Entry& entry = entries[i];
    const vec3 off = entry.position - position;
    const float distance2 = glm::dot(off, off);
    if (distance2 >= radius * radius || (entry.photon & 7u) != parity(here)) continue;
    use(photons[entry.photon >> 3], distance2);
  }
}

/// From the widest disks to the narrowest, as long as there are any in the cell.
std::uint32_t CausticMap::near(const vec3& position) const {
  if (grids_.empty()) return 0;
  const glm::ivec3 finest = grids_.front().cell(position);
  std::uint32_t found = 0;
  for (std::size_t i = grids_.size(); i-- > 0;) {
    const auto up = static_cast<int>(grids_[i].level - grids_.front().level);
    const std::uint32_t marks = grids_[i].marked(finest >> up);
    found |= (marks & Grid::kHere) << i;
    if ((marks & Grid::kFiner) == 0) break;
  }
  return found;
}

template <typename Scattered>
vec3 CausticMap::radianceOf(const vec3& at, std::uint32_t near, const vec3& normal,
                            std::uint32_t turns, const Scattered& scattered) const {
  vec3 sum(0.0f);
  for (; near != 0; near &= near - 1) {
    const Grid& grid = grids_[static_cast<std::size_t>(std::countr_zero(near))];
    grid.forNear(at, [&](const CausticPhoton& p, float distance2) {
      if (p.turns > turns || !sameSurface(p, at, normal, grid.radius)) return;
      // Flux is by the surface's own area.
      const float cosine = std::max(std::abs(glm::dot(p.towards, normal)), kGrazing);
      sum += scattered(p) * p.power * (kernel(distance2, grid.radius) / cosine);
    });
  }
  return sum;
}

vec3 CausticMap::radiance(const vec3& at, std::uint32_t near, const Bsdf& bsdf, bool sharpToo,
                          std::uint32_t turns) const {
  if (!sharpToo && !bsdf.hasBroad()) return vec3(0.0f);
  return radianceOf(at, near, bsdf.geometricNormal(), turns, [&](const CausticPhoton& p) {
    return bsdf.evaluate(p.towards, sharpToo && !p.blurred ? LobeKind::kAll : LobeKind::kBroad);
  });
}

vec3 CausticMap::radiance(const vec3& at, std::uint32_t near, const MatteSurface& surface,
                          std::uint32_t turns) const {
  return radianceOf(at, near, surface.facing, turns,
                    [&](const CausticPhoton& p) { return surface.evaluate(p.towards); });
}

}  // namespace trex
