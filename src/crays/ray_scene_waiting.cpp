// Rays that do not wait for pages where they are traced: RayScene::intersectHere(), occludedHere().
#include "src/crays/waiting_ray.h"

#include "src/crays/ray_scene_impl.h"

namespace trex {
namespace {

using Group = WaitingRay::Group;

/// Embree's entry into a box is not later than ours by more than this share.
constexpr float kEmbreeMargin = 0x1p-14f;

/// A group whose page is not there. The ray need not go beyond the last that it can hold.
void note(WaitingRay& ray, const Group& group, RTCRay& embree) {
  std::uint32_t at = ray.count;
  while (at > 0 && group.before(ray.groups[at - 1])) --at;
  if (at == WaitingRay::kGroups) return;
  if (ray.count < WaitingRay::kGroups) ++ray.count;
  for (std::uint32_t i = ray.count - 1u; i > at; --i) ray.groups[i] = ray.groups[i - 1];
  ray.groups[at] = group;
  if (ray.count < WaitingRay::kGroups) return;
  const float last = ray.groups[WaitingRay::kGroups - 1].entry;
  embree.tfar = std::min(embree.tfar, last + std::abs(last) * kEmbreeMargin);
}

/// A mesh, or a group of one in pages that is there. True if the ray has its answer by it.
template <typename Intersect, typename Occluded>
bool meet(TraceContext& context, std::uint32_t instance, const Intersect& intersect,
          const Occluded& occluded) {
  if (context.shadow) return context.waits->blocked = occluded();
  hccm::Hit hit = bestFor(context, instance);
  if (intersect(hit)) {
    context.best = {hit.u, hit.v, hit.t, instance, hit.cluster, hit.triangle};
    context.far = context.tfar = hit.t;
  }
  return false;
}

bool meetGroup(TraceContext& context, const hccm::PagedMesh& mesh, std::uint32_t group) {
  return meet(
      context, RayScene::kWorldMesh,
      [&](hccm::Hit& hit) { return mesh.intersect(group, context.prepared, hit, context.pin); },
      [&] { return mesh.occluded(group, context.prepared, context.pin); });
}

}  // namespace

void meetWithoutWaiting(const RTCIntersectFunctionNArguments* args, const Traced& traced,
                        TraceContext& context) {
  RTCRay& embree = reinterpret_cast<RTCRayHit*>(args->rayhit)->ray;
  WaitingRay& ray = *context.waits;
  bool answered = false;
  if (traced.paged == nullptr) {
    context.prepare(*traced.mesh, traced, embree);
    answered = meet(
        context, context.instanceOf(traced),
        [&](hccm::Hit& hit) { return traced.mesh->intersect(context.prepared, hit); },
        [&] { return traced.mesh->occluded(context.prepared); });
  } else {
    context.prepare(*traced.paged, traced, embree);
    const hccm::PagedMesh& mesh = *traced.paged;
    const Group group{mesh.entry(args->primID, context.prepared), args->primID,
                      mesh.table().groups[args->primID].page};
    if (!ray.done.before(group) || group.entry > context.tfar) return;
    if (!mesh.reachIfHere(group.group, context.pin)) return note(ray, group, embree);
    answered = meetGroup(context, mesh, group.group);
  }
  embree.tfar = answered ? -kInfinity : std::min(embree.tfar, context.tfar);
}

namespace {

/// Meets the groups that it waits for and that are there now.
void meetNoted(TraceContext& context, const hccm::PagedMesh& mesh) {
  WaitingRay& ray = *context.waits;
  context.prepare(mesh, RayScene::kWorldMesh, context.tnear, context.tfar);
  std::uint8_t left = 0;
  for (std::uint32_t i = 0; i < ray.count && !ray.blocked; ++i) {
    const Group group = ray.groups[i];
    if (group.entry > context.tfar) break;  // nor are those behind it any use
    if (mesh.reachIfHere(group.group, context.pin)) {
      meetGroup(context, mesh, group.group);
    } else {
      ray.groups[left++] = group;
    }
  }
  while (left > 0 && ray.groups[left - 1].entry > context.tfar) --left;
  ray.count = left;
}

/// Looks for groups behind those that are done.
void lookFurther(TraceContext& context, RTCScene scene, const vec3& origin) {
  WaitingRay& ray = *context.waits;
  const float entry = ray.done.entry;
  const float from = entry > 0.0f ? entry - entry * kEmbreeMargin : 0.0f;
  RTCRayHit embree;
  setRay(embree.ray, origin, context.query.direction, std::max(context.tnear, from), context.tfar);
  embree.hit.geomID = embree.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  rtcIntersect1(scene, &context.embree, &embree);
  ray.more = ray.count == WaitingRay::kGroups;
  if (ray.more) ray.done = ray.groups[WaitingRay::kGroups - 1];
  while (ray.count > 0 && ray.groups[ray.count - 1].entry > context.tfar) --ray.count;
}

}  // namespace

bool RayScene::Impl::advance(const RayQuery& query, WaitingRay& ray, bool shadow,
                             const hccm::Passage* passages) const {
  if (ray.answered) return true;
  RayStart near = query.start;
  float tnear = query.tnear, tfar = query.end.distance;
  double shift = 0.0;
  if (!visibility.clip(query.start.position, query.direction, tnear, tfar) ||
      !approach.bring(near.position, query.direction, tnear, tfar, shift))
    return ray.answered = true;
  const Query asked{near, query.direction, query.end};
  TraceContext context(asked, visibility, placements, worldPlacement);
  context.waits = &ray;
  context.shadow = shadow;
  hccm::Passages seen{passages, ray.passed};
  if (passages != nullptr) context.passages = &seen;
  context.best = ray.best;
  context.tnear = tnear;
  context.tfar = ray.hit() ? ray.best.t : tfar;
  if (ray.count > 0) meetNoted(context, *parts.paged);
  if (ray.count == 0 && !ray.blocked && ray.more && !(ray.done.entry > context.tfar))
    lookFurther(context, top.scene, vec3(near.position));
  ray.best = context.best;
  ray.passed = seen.met;
  if (ray.count > 0 && !ray.blocked) return false;
  // What is behind the last group that it could hold is met at once if all that it held is done.
  if (!ray.blocked && ray.more && !(ray.done.entry > context.tfar))
    return advance(query, ray, shadow, passages);
  if (shift != 0.0 && ray.hit()) ray.best.t = static_cast<float>(ray.best.t + shift);
  return ray.answered = true;
}

bool RayScene::intersectHere(const RayQuery& query, WaitingRay& ray) const {
  return impl_->advance(query, ray, false, nullptr);
}
bool RayScene::occludedHere(const RayQuery& query, WaitingRay& ray,
                            const hccm::Passage* passages) const {
  return impl_->advance(query, ray, true, passages);
}
bool RayScene::meetHere(const RayQuery& query, WaitingRay& ray) const {
  return intersectHere(query, ray) && (!ray.hit() || surfaceIsHere(ray.best));
}
std::uint32_t RayScene::awaited(const WaitingRay& ray) const {
  return ray.answered ? pageOf(ray.best) : ray.page();
}
bool RayScene::surfaceIsHere(const RayHit& hit) const {
  const std::uint32_t page = pageOf(hit);
  return page == WaitingRay::kNoPage || impl_->parts.paged->cache().isHere(page);
}

std::uint32_t RayScene::pageOf(const RayHit& hit) const {
  const bool paged = hit.instance == kWorldMesh && impl_->parts.paged;
  return paged ? hit.cluster / hccm::kPageClusters : WaitingRay::kNoPage;
}

}  // namespace trex
