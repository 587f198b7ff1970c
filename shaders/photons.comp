// Photons: deposits records as direct flux and bounces them through the ASVO (photon.h).
// In: the tree (tree.h), records, materials. Out: sums of direct and indirect flux, counters.
//
// An invocation takes photons first + id, first + id + stride, ...: when one ends it starts the next,
// so that the lanes of a subgroup stay busy although paths differ in length.
#version 450
#extension GL_GOOGLE_include_directive : require
#include "asvo/asvo_layout.h"
#include "src/grays/shaderio.h"

layout(local_size_x_id = 0) in;

layout(push_constant) uniform Push {
  AsvoInfo info;
  uint gridLevel;
  uint firstBrick;
  uint first;   // of this dispatch
  uint end;     // one past its last record
  uint stride;  // invocations that take records
  uint materialCount;
  float countsPerWatt;
} push;

#include "shaders/tree.h"

layout(std430, set = 0, binding = 5) readonly buffer RecordBuffer { PhotonRecord records[]; };
layout(std430, set = 0, binding = 6) readonly buffer MaterialBuffer { PhotonMaterial materials[]; };
layout(std430, set = 0, binding = 7) buffer DirectBuffer { uint directSums[]; };
layout(std430, set = 0, binding = 8) buffer IndirectBuffer { uint indirectSums[]; };
layout(std430, set = 0, binding = 9) buffer CounterBuffer { uint counters[]; };

// 64-bit sums as two words: whoever makes the low word wrap carries one into the high word. The
// number of wraps does not depend on the order, so neither does the sum.
void addDirect(uint i, uint low, uint high) {
  uint old = atomicAdd(directSums[2u * i], low);
  uint carry = old + low < old ? 1u : 0u;
  if (high + carry != 0u) atomicAdd(directSums[2u * i + 1u], high + carry);
}
void addIndirect(uint i, uint low, uint high) {
  uint old = atomicAdd(indirectSums[2u * i], low);
  uint carry = old + low < old ? 1u : 0u;
  if (high + carry != 0u) atomicAdd(indirectSums[2u * i + 1u], high + carry);
}
#define PHOTON_MATERIAL(i) materials[i]
#define PHOTON_MATERIAL_COUNT push.materialCount
#define PHOTON_ADD_DIRECT(i, lo, hi) addDirect(i, lo, hi)
#define PHOTON_ADD_INDIRECT(i, lo, hi) addIndirect(i, lo, hi)
#include "shaders/random.h"
#include "shaders/photon.h"

void main() {
  if (gl_GlobalInvocationID.x >= push.stride) return;
  uint deposits = 0u;
  uint lost = 0u;
  uint next = push.first + gl_GlobalInvocationID.x;
  PhotonPath path;
  path.alive = false;
  while (path.alive || next < push.end) {
    if (path.alive) {
      photonStep(path, push.countsPerWatt);
    } else {
      path = photonBegin(records[next], push.countsPerWatt);
      next += push.stride;
    }
    if (!path.alive) {
      deposits += path.deposits;
      lost += path.lost;
    }
  }
  if (deposits != 0u) atomicAdd(counters[0], deposits);
  if (lost != 0u) atomicAdd(counters[1], lost);
}
