// Counter-based random numbers, included by C++ and GLSL: no state, so photons may be traced in any
// order and by any thread. pcg3d of Jarzynski and Olano, "Hash Functions for GPU Rendering", JCGT
// 9(3), 2020. The including text provides uvec3 and RANDOM_FN (storage class of a function).
#ifndef TREX_RANDOM_H
#define TREX_RANDOM_H
#ifndef __cplusplus
#define RANDOM_FN
#endif

/// Three independent 32-bit numbers for the key (x, y, z).
RANDOM_FN uvec3 randomBits(uint x, uint y, uint z) {
  uint a = x * 1664525u + 1013904223u;
  uint b = y * 1664525u + 1013904223u;
  uint c = z * 1664525u + 1013904223u;
  a += b * c;
  b += c * a;
  c += a * b;
  a ^= a >> 16u;
  b ^= b >> 16u;
  c ^= c >> 16u;
  a += b * c;
  b += c * a;
  c += a * b;
  return uvec3(a, b, c);
}

/// Three numbers in [0, 1), multiples of 2^-24.
RANDOM_FN vec3 randomUnit(uint x, uint y, uint z) {
  uvec3 bits = randomBits(x, y, z);
  return vec3(float(bits.x >> 8u), float(bits.y >> 8u), float(bits.z >> 8u)) * 5.9604645e-8f;
}

#endif
