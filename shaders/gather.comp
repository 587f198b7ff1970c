// Gathers cached radiance: one cone through the ASVO an invocation. Cones that start wide take a
// variant without the code for the finest levels (asvo_trace.h).
// In: the tree (tree.h), queries. Out: results, each at its query's index; with TREX_PAGED the marks of
// pages too.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "asvo/asvo_layout.h"
#include "src/grays/shaderio.h"

layout(local_size_x_id = 0) in;
layout(constant_id = 1) const bool kFine = true;
#define ASVO_FINE kFine

layout(push_constant) uniform Push {
  AsvoInfo info;
  uint gridLevel;
  uint firstBrick;
  uint first;  // of this dispatch
  uint end;    // one past its last query
} push;

#ifdef TREX_PAGED
const int kQueryBinding = 4;
const int kMarksBinding = 6;
#else
const int kQueryBinding = 5;
#endif
#include "shaders/tree.h"

#ifdef TREX_TEXELS
layout(set = 0, binding = kQueryBinding) uniform utextureBuffer queryTexels;  // three a query
GatherQuery readQuery(uint i) {
  uvec4 a = texelFetch(queryTexels, int(3u * i));
  uvec4 b = texelFetch(queryTexels, int(3u * i + 1u));
  uvec4 c = texelFetch(queryTexels, int(3u * i + 2u));
  vec4 x = uintBitsToFloat(a), y = uintBitsToFloat(b);
  return GatherQuery(x.xyz, x.w, y.xyz, y.w, uintBitsToFloat(c.x), uintBitsToFloat(c.y), c.z, c.w);
}
#else
layout(std430, set = 0, binding = kQueryBinding) readonly buffer QueryBuffer { GatherQuery queries[]; };
GatherQuery readQuery(uint i) { return queries[i]; }
#endif
layout(std430, set = 0, binding = kQueryBinding + 1) writeonly buffer ResultBuffer { GatherResult results[]; };

void main() {
  uint i = push.first + gl_GlobalInvocationID.x;
  if (i >= push.end) return;
  GatherQuery query = readQuery(i);
  bool lit = (query.flags & kQueryShadow) == 0u;
  AsvoCone cone = asvoMarch(query.origin, query.direction, query.tanHalf, query.tmin, query.tmax,
                            query.jitter, lit);
  results[query.index] = GatherResult(cone.radiance, cone.transmittance);
}
