// Gathers cached radiance: one cone through the ASVO an invocation.
// In: the tree (tree.h), queries. Out: results, in the same order.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "asvo/asvo_layout.h"
#include "src/grays/shaderio.h"

layout(local_size_x_id = 0) in;

layout(push_constant) uniform Push {
  AsvoInfo info;
  uint gridLevel;
  uint first;  // of this dispatch
  uint end;    // one past its last query
} push;

#include "shaders/tree.h"

layout(std430, set = 0, binding = 5) readonly buffer QueryBuffer { GatherQuery queries[]; };
layout(std430, set = 0, binding = 6) writeonly buffer ResultBuffer { GatherResult results[]; };

void main() {
  uint i = push.first + gl_GlobalInvocationID.x;
  if (i >= push.end) return;
  GatherQuery query = queries[i];
  bool lit = (query.flags & kQueryShadow) == 0u;
  AsvoCone cone = asvoMarch(query.origin, query.direction, query.tanHalf, query.tmin, query.tmax,
                            query.jitter, lit);
  results[i] = GatherResult(cone.radiance, cone.transmittance);
}
