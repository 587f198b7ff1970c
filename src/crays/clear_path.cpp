#include "src/crays/clear_path.h"

#include <algorithm>
#include <cmath>
#include <span>

#include "src/crays/ray_scene_parts.h"
#include "src/crays/waiting_ray.h"
#include "src/scene/look.h"

namespace trex {
namespace {

constexpr float kBeforeTheEnd = 0.9999f;  // of a ray that refraction lets miss its light a little
constexpr float kLeastPassed = 1e-4f;     // less counts as nothing
/// Of refraction: where the aim of a shadow ray is put right. The way through a pane moves a ray by
/// less than the pane's thickness, and nearly as much for the next aim.
constexpr int kMostAims = 5;
constexpr float kMiss = 1e-4f;  // of the distance, at the light

/// Boxes that the refracting clusters of a scene are gathered in: 2^3.
constexpr int kBoxHalvings = 3;

Box3f moved(const Box3f& box, const dmat4& matrix) {
  Box3f out;
  for (int corner = 0; corner < 8; ++corner) {
    const dvec3 p((corner & 1) ? box.upper.x : box.lower.x,
                  (corner & 2) ? box.upper.y : box.lower.y,
                  (corner & 4) ? box.upper.z : box.lower.z);
    out.extend(vec3(matrix * glm::dvec4(p, 1.0)));
  }
  const vec3 margin = 0x1p-20f * (glm::abs(out.lower) + glm::abs(out.upper));  // of this rounding
  return {out.lower - margin, out.upper + margin};
}

/// Boxes of halves of halves, by place.
void gather(std::span<Box3f> boxes, int halvings, std::vector<Box3f>& out) {
  if (boxes.empty()) return;
  Box3f all, centres;
  for (const Box3f& b : boxes) all.extend(b), centres.extend(b.centre());
  if (halvings == 0 || boxes.size() == 1) {
    out.push_back(all);
    return;
  }
  const vec3 size = centres.size();
  const int axis = size.x > size.y ? (size.x > size.z ? 0 : 2) : (size.y > size.z ? 1 : 2);
  const auto middle = boxes.begin() + static_cast<std::ptrdiff_t>(boxes.size() / 2);
  std::nth_element(boxes.begin(), middle, boxes.end(), [&](const Box3f& a, const Box3f& b) {
    return a.centre()[axis] < b.centre()[axis];
  });
  gather({boxes.begin(), middle}, halvings - 1, out);
  gather({middle, boxes.end()}, halvings - 1, out);
}

}  // namespace

void ClearPath::begin(const vec3& direction, float length) {
  *this = ClearPath();
  begun_ = true;
  direction_ = direction;
  xx_ = yy_ = length;
}

void ClearPath::advance(float length) {
  const float sagittal = length / index_, more = sagittal * (stretch_ - 1.0f);
  xx_ += sagittal + more * axis_.x * axis_.x;
  xy_ += more * axis_.x * axis_.y;
  yy_ += sagittal + more * axis_.y * axis_.y;
}

void ClearPath::refract(const vec3& normal, float eta, const vec3& after) {
  index_ *= eta;
  const vec3 local = Basis(direction_).toLocal(normal);
  const vec2 across(local.x, local.y);
  const float length = glm::length(across);
  axis_ = length > 0.0f ? across / length : vec2(1.0f, 0.0f);
  const float inside = glm::dot(after, normal);
  stretch_ = local.z * local.z / std::max(inside * inside, 1e-12f);
}

bool ClearPath::straight(const vec3& last) const {
  if (!begun_) return true;
  const vec3 difference = last - direction_;
  return std::abs(index_ - 1.0f) < 1e-4f &&
         glm::dot(difference, difference) < kStraight * kStraight;
}

namespace {

bool letsPass(const Material& m) { return isClearGlass(m) || m.alphaMode != AlphaMode::kOpaque; }

}  // namespace

bool ClearLayers::blockOnly(const Scene& scene) {
  return std::ranges::none_of(scene.materials, letsPass);
}

ClearLayers::ClearLayers(const Scene& scene, const RayScene& rays) : scene_(scene), rays_(rays) {
  for (const Material& m : scene.materials) {
    const bool passes = letsPass(m);
    const bool glass = isClearGlass(m) && passesLight(m);
    const bool bends = isClearGlass(m) && m.volume;
    passages_.push_back(passes ? hccm::Passage::kPasses : hccm::Passage::kBlocks);
    bends_.push_back(bends ? hccm::Passage::kBlocks : hccm::Passage::kAbsent);
    glass_.push_back(glass ? 1 : 0);
    any_ |= passes;
    anyGlass_ |= glass;
    anyBends_ |= bends;
  }
  if (anyBends_) findBends();
}

void ClearLayers::findBends() {
  std::vector<Box3f> found;
  const auto add = [&](const hccm::Mesh& mesh, const dmat4& toRender) {
    for (std::uint32_t c = 0; c < mesh.clusterCount(); ++c) {
      if (bends_[mesh.clusterMaterial(c)] == hccm::Passage::kAbsent) continue;
      Box3f cluster;
      mesh.clusterBounds(c, cluster.lower, cluster.upper);
      found.push_back(moved(cluster, toRender));
    }
  };
  const RayScene::Parts& parts = rays_.parts();
  if (parts.paged) found.push_back(rays_.bounds());
  add(parts.world, dmat4(1.0));
  for (const RayScene::Parts::Placed& p : parts.placed) {
    add(parts.shared[p.mesh], placeOf(scene_, parts, p).toRender);
  }
  for (const Box3f& box : found) bendBox_.extend(box);
  gather(found, kBoxHalvings, bendBoxes_);
}

/// Whether anything that refracts may lie between, by boxes alone.
bool ClearLayers::mayMeetBends(const RayStart& start, const vec3& direction,
                               const RayEnd& end) const {
  const vec3 origin(start.position), inverse = 1.0f / direction;
  const auto meets = [&](const Box3f& box) {
    const vec3 a = (box.lower - origin) * inverse, b = (box.upper - origin) * inverse;
    const float enters = maxComponent(glm::min(a, b));
    const float leaves = -maxComponent(-glm::max(a, b));
    return !(enters > leaves || leaves < 0.0f || enters > end.distance);  // true if not a number
  };
  return anyBends_ && meets(bendBox_) && std::any_of(bendBoxes_.begin(), bendBoxes_.end(), meets);
}

bool ClearLayers::meetsBends(const RayStart& start, const vec3& direction,
                             const RayEnd& end) const {
  hccm::Passages bends{bends_.data()};
  return mayMeetBends(start, direction, end) && rays_.occluded(start, direction, 0.0f, end, &bends);
}

bool ClearLayers::pass(const Surface& surface, const Bsdf& bsdf, ClearWalk& walk) const {
  vec3 through = bsdf.clearTransmission();
  if (!clear(bsdf)) through = vec3(0.0f);
  const vec3 all = vec3(1.0f - bsdf.coverage()) + bsdf.coverage() * through;
  if (!(maxComponent(walk.passed * all) > kLeastPassed)) return false;
  if (bsdf.refracts() && clear(bsdf)) {
    vec3 next;
    if (!bsdf.clearRefraction(next)) return false;
    if (!walk.path.begun()) walk.path.begin(walk.direction, walk.length);
    walk.path.refract(bsdf.normal(), bsdf.eta(), next);
    walk.absorption = bsdf.absorptionTowards(next, walk.absorption);
    walk.direction = next;
  }
  walk.passed *= all;
  if (isGlass(surface.material)) walk.glass *= all;
  walk.start = surface.leave();
  return true;
}

bool ClearLayers::pass(const Surface& surface, ClearWalk& walk) const {
  return passages_[surface.material] != hccm::Passage::kBlocks &&
         pass(surface, Bsdf(scene_, surface, -walk.direction), walk);
}

ClearWalk ClearLayers::walk(const RayStart& start, const vec3& direction, const RayEnd& end,
                            const vec3& absorption) const {
  ClearWalk walk{.start = start, .direction = direction, .absorption = absorption};
  follow(walk, end, nullptr);
  return walk;
}

bool ClearLayers::meet(const ClearWalk& walk, const RayEnd& end, WaitingRay* waits, RayHit& hit,
                       bool& met) const {
  if (waits == nullptr) {
    met = rays_.intersect(walk.start, walk.direction, 0.0f, end, hit);
    return true;
  }
  if (!rays_.meetHere({walk.start, walk.direction, 0.0f, end}, *waits)) return false;
  met = waits->hit();
  hit = waits->best;
  *waits = WaitingRay();
  return true;
}

/// The rest of a walk. False if it waits for a page.
bool ClearLayers::follow(ClearWalk& walk, const RayEnd& end, WaitingRay* waits) const {
  RayEnd rest = end;
  for (; walk.layers < kMost; ++walk.layers) {
    float left = end.distance;
    if (end.point) {
      left = std::max(glm::dot(vec3(*end.point - walk.start.position), walk.direction), 0.0f);
      rest.distance = walk.path.begun() ? left * kBeforeTheEnd : left;
    }
    RayHit hit;
    bool met = false;
    if (!meet(walk, rest, waits, hit, met)) return false;
    if (!met) {
      if (end.point) walk.advance(left);
      return true;
    }
    walk.advance(hit.t);
    if (!pass(rays_.surface(hit), walk)) break;
  }
  walk.blocked = true;
  return true;
}

LightConnection ClearLayers::connect(const RayStart& start, const vec3& direction,
                                     const RayEnd& end, const vec3& absorption) const {
  // Most rays meet nothing clear: whether they are blocked is all that there is to know.
  const vec3 towards = end.point ? vec3(glm::normalize(*end.point - start.position)) : direction;
  hccm::Passages seen{passages_.data()};
  const bool blocked = rays_.occluded(start, towards, 0.0f, end, any_ ? &seen : nullptr);
  // What blocks the straight line need not block the one that glass bends.
  if (blocked ? meetsBends(start, towards, end) : seen.met) {
    WaitingConnection way;
    aim(start, direction, end, absorption, nullptr, way);
    return way.found;
  }
  return blocked ? LightConnection{.direction = direction} : unblocked(direction, end, absorption);
}

bool ClearLayers::connectHere(const RayStart& start, const vec3& direction, const RayEnd& end,
                              const vec3& absorption, WaitingRay& ray,
                              WaitingConnection& way) const {
  using Stage = WaitingConnection::Stage;
  const vec3 towards = end.point ? vec3(glm::normalize(*end.point - start.position)) : direction;
  const RayQuery straight{start, towards, 0.0f, end};
  const auto answer = [&](const LightConnection& found) {
    ray = WaitingRay();
    way.found = found;
    way.stage = Stage::kFound;
    return true;
  };
  if (way.stage == Stage::kStraight) {
    if (!rays_.occludedHere(straight, ray, any_ ? passages_.data() : nullptr)) return false;
    if (!ray.blocked && !ray.passed) return answer(unblocked(direction, end, absorption));
    if (ray.blocked && !mayMeetBends(start, towards, end)) return answer({.direction = direction});
    way.stage = ray.blocked ? Stage::kBends : Stage::kAims;
    ray = WaitingRay();
  }
  if (way.stage == Stage::kBends) {
    if (!rays_.occludedHere(straight, ray, bends_.data())) return false;
    if (!ray.blocked) return answer({.direction = direction});
    way.stage = Stage::kAims;
    ray = WaitingRay();
  }
  if (way.stage == Stage::kFound) return true;
  return aim(start, direction, end, absorption, &ray, way) && answer(way.found);
}

LightConnection ClearLayers::unblocked(const vec3& direction, const RayEnd& end,
                                       const vec3& absorption) {
  LightConnection out;
  out.direction = direction;
  out.passed = absorption == vec3(0.0f) ? vec3(1.0f) : glm::exp(-absorption * end.distance);
  return out;
}

/// As connect(): turns the ray until it meets the light behind the panes. False if it waits for a
/// page.
bool ClearLayers::aim(const RayStart& start, const vec3& direction, const RayEnd& end,
                      const vec3& absorption, WaitingRay* waits, WaitingConnection& way) const {
  RayEnd light = end;
  if (end.distance < kInfinity && !end.point)
    light.point = start.position + dvec3(direction) * double(end.distance);
  for (; way.turn < kMostAims; ++way.turn) {
    if (way.turn == 0 && !way.walking) {
      way.found = {};
      way.found.direction =
          end.point ? vec3(glm::normalize(*end.point - start.position)) : direction;
      way.goal = light.point.value_or(dvec3(0.0));
    }
    if (!way.walking) {
      way.walk = {.start = start, .direction = way.found.direction, .absorption = absorption};
    }
    way.walking = true;
    if (!follow(way.walk, light, waits)) return false;
    way.walking = false;
    if (takeAim(start, direction, light, way)) break;
  }
  return true;
}

/// What has become of an aim. True if that is the answer; else there is another aim.
bool ClearLayers::takeAim(const RayStart& start, const vec3& direction, const RayEnd& light,
                          WaitingConnection& way) const {
  const ClearWalk& walk = way.walk;
  LightConnection& out = way.found;
  const vec3 passed = walk.blocked ? vec3(0.0f) : walk.passed;
  if (!walk.path.begun()) {
    // Past the glass that the straight line meets: it leads to another place than the light's.
    if (way.turn == 0) {
      out = {};
      out.passed = passed;
      out.direction = direction;
    }
    return true;
  }
  out.refracted = true;
  if (!walk.path.straight(walk.direction)) return true;
  const float distance = light.distance;
  if (!(distance < kInfinity)) {
    out.passed = passed;
    return true;
  }
  const vec3 rest(*light.point - walk.start.position);
  const vec3 miss = rest - walk.direction * glm::dot(rest, walk.direction);
  if (glm::dot(miss, miss) <= kMiss * kMiss * distance * distance) {
    out.passed = passed;
    out.focus = distance * distance / walk.path.spread();
    return true;
  }
  way.goal += dvec3(miss);
  out.direction = vec3(glm::normalize(way.goal - start.position));
  return false;
}

}  // namespace trex
