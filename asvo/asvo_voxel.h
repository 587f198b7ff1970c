// What a voxel's words say: the part of asvo_trace.h, which includes it, that reads one voxel and
// does not march. One text, compiled as GLSL and as C++ in the body of class Tracer, as that one.

// --- Packed values ------------------------------------------------------------------------------

/// Shared-exponent RGB (EXT_texture_shared_exponent): 9 bits each, exponent 5 bits with bias 15.
vec3 asvoUnpackRgb9e5(uint packed) ASVO_READS {
  float scale = uintBitsToFloat(((packed >> 27) + 103u) << 23);  // 2^(e - 15 - 9)
  return vec3(ivec3(uvec3(packed & 511u, (packed >> 9) & 511u, (packed >> 18) & 511u))) * scale;
}

/// Clamps to [0, 65408]; NaN becomes 0.
uint asvoPackRgb9e5(vec3 v) ASVO_READS {
  float r = v.x > 0.0f ? min(v.x, 65408.0f) : 0.0f;
  float g = v.y > 0.0f ? min(v.y, 65408.0f) : 0.0f;
  float b = v.z > 0.0f ? min(v.z, 65408.0f) : 0.0f;
  float top = max(r, max(g, b));
  // Exponent of the largest component, biased by 15, such that it lies in [2^8, 2^9) after scaling.
  int e = max(int(floatBitsToUint(top) >> 23) - 127, -16) + 16;
  float scale = uintBitsToFloat(uint(127 - (e - 24)) << 23);
  if (top * scale + 0.5f >= 512.0f) {
    e += 1;
    scale *= 0.5f;
  }
  return uint(r * scale + 0.5f) | (uint(g * scale + 0.5f) << 9) | (uint(b * scale + 0.5f) << 18) |
         (uint(e) << 27);
}

/// Unit vector of octahedral coordinates in [-1, 1] [Cigolle et al., JCGT 2014].
vec3 asvoOctUnfold(float x, float y) ASVO_READS {
  float z = 1.0f - abs(x) - abs(y);
  float fold = max(-z, 0.0f);
  return normalize(vec3(x + (x >= 0.0f ? -fold : fold), y + (y >= 0.0f ? -fold : fold), z));
}

/// Of 2 x unorm16, x lowest.
vec3 asvoOctDecode(uint packed) ASVO_READS {
  return asvoOctUnfold(float(int(packed & 65535u)) * (2.0f / 65535.0f) - 1.0f,
                       float(int(packed >> 16)) * (2.0f / 65535.0f) - 1.0f);
}

/// To 2 x `levels` + 1 whole numbers, the second `shift` bits up.
uint asvoOctFold(vec3 n, float levels, uint shift) ASVO_READS {
  float s = 1.0f / max(abs(n.x) + abs(n.y) + abs(n.z), 1e-30f);
  float x = n.x * s;
  float y = n.y * s;
  if (n.z < 0.0f) {
    float fx = (1.0f - abs(y)) * (x >= 0.0f ? 1.0f : -1.0f);
    float fy = (1.0f - abs(x)) * (y >= 0.0f ? 1.0f : -1.0f);
    x = fx;
    y = fy;
  }
  uint px = uint(min(max(0.0f, x * 0.5f + 0.5f), 1.0f) * levels + 0.5f);
  uint py = uint(min(max(0.0f, y * 0.5f + 0.5f), 1.0f) * levels + 0.5f);
  return px | (py << shift);
}

uint asvoOctEncode(vec3 n) ASVO_READS { return asvoOctFold(n, 65535.0f, 16u); }

/// Normal of a voxel, from its word y: 2 x unorm13 from bit 6 on.
vec3 asvoUnpackNormal(uint word) ASVO_READS {
  return asvoOctUnfold(float(int((word >> 6) & 8191u)) * (2.0f / 8191.0f) - 1.0f,
                       float(int(word >> 19)) * (2.0f / 8191.0f) - 1.0f);
}

/// Those bits of the word.
uint asvoPackNormal(vec3 n) ASVO_READS { return asvoOctFold(n, 8191.0f, 13u) << 6; }

vec3 asvoUnpackAlbedo(uint packed) ASVO_READS {
  return vec3(float(packed & 255u), float((packed >> 8) & 255u), float((packed >> 16) & 255u)) *
         (1.0f / 255.0f);
}

// --- Voxels -------------------------------------------------------------------------------------

/// Diffuse albedo, linear, [0, 1].
vec3 asvoAlbedo(uint voxel) ASVO_READS { return asvoUnpackAlbedo(ASVO_VOXEL(voxel).z); }

/// Unit normal; its side is the front.
vec3 asvoNormal(uint voxel) ASVO_READS { return asvoUnpackNormal(ASVO_VOXEL(voxel).y); }

/// The material with the largest area in the voxel.
uint asvoMaterial(uint voxel) ASVO_READS { return ASVO_VOXEL(voxel).w & 65535u; }

/// Whether all surfaces in a voxel lie near its plane.
bool asvoHasPlane(uint voxel) ASVO_READS { return ASVO_VOXEL(voxel).z >> 24 != 0u; }

/// How much of the faces in a voxel sends light by its direction: 0 none, 1 some, 2 an eighth or
/// more, 3 half or more.
uint asvoDirectional(uvec4 v) ASVO_READS { return v.x >> 30; }

/// Triangle area of each side, in faces of the voxel.
float asvoArea(uint voxel) ASVO_READS {
  uint code = ASVO_VOXEL(voxel).w >> 16;
  float unit = uintBitsToFloat(((code >> 11) + 95u) << 23);  // 2^(upper 5 bits - 32)
  return code != 0u ? float(int(2048u + (code & 2047u))) * unit : 0.0f;
}

/// Coverage towards +x, -x, +y, -y, +z, -z, in 1/63.
uint asvoCoverage(uvec4 v, uint direction) ASVO_READS {
  return (direction < 5u ? v.x >> (6u * direction) : v.y) & 63u;
}

/// Whether the surfaces in a voxel above the leaves lie off any plane, and hide much of what is
/// behind them: edges, corners, layers. Not leaves of trees, which cones see through.
bool asvoUneven(uint voxel) ASVO_READS {
  uvec4 v = ASVO_VOXEL(voxel);
  if (((v.z >> 24) & 31u) != 0u) return false;
  uint covered = 0u;
  for (uint side = 0u; side < 6u; ++side) covered = max(covered, asvoCoverage(v, side));
  return covered >= kAsvoLeastUneven;
}

/// Area that the coverage of a voxel's faces leaves room for, in faces of the voxel: where there is
/// more, layers hide each other.
float asvoShownArea(uint voxel) ASVO_READS {
  uvec4 v = ASVO_VOXEL(voxel);
  uint x = max(asvoCoverage(v, 0u), asvoCoverage(v, 1u));
  uint y = max(asvoCoverage(v, 2u), asvoCoverage(v, 3u));
  uint z = max(asvoCoverage(v, 4u), asvoCoverage(v, 5u));
  return float(int(x + y + z)) * (1.0f / 63.0f);
}

/// Whether the front of a child is part of the back of its parent: sums over sides that go up the
/// tree exchange the sides then.
bool asvoFlips(uint child, uint parent) ASVO_READS {
  return dot(asvoNormal(child), asvoNormal(parent)) < 0.0f;
}

/// How much a voxel of that coverage (in 1/63) takes of light along an axis: -log2 of what is
/// clear, in 1/255 of 8, in a byte.
uint asvoExtinction(uint covered) ASVO_READS {
  float coverage = min(float(int(covered)) * (kAsvoCoverageGain / 63.0f), kAsvoMaxCoverage);
  return uint(-log2(1.0f - coverage) * (255.0f / 8.0f) + 0.5f);
}

/// A component of a unit vector in 10 bits.
uint asvoPackComponent(float x) ASVO_READS { return uint(x * 511.0f + 511.5f); }

/// The bit of asvoConeWords that says that voxels do not know its light.
uint asvoConeMark(uvec4 v) ASVO_READS { return asvoDirectional(v) >= 2u ? ASVO_CONE_UNKNOWN : 0u; }

/// The half of asvoConeWords that does not depend on light.
uvec2 asvoConeShape(uvec4 v) ASVO_READS {
  vec3 n = asvoUnpackNormal(v.y);
  uint x = asvoExtinction(max(asvoCoverage(v, 0u), asvoCoverage(v, 1u)));
  uint y = asvoExtinction(max(asvoCoverage(v, 2u), asvoCoverage(v, 3u)));
  uint z = asvoExtinction(max(asvoCoverage(v, 4u), asvoCoverage(v, 5u)));
  uint normal =
      asvoPackComponent(n.x) | (asvoPackComponent(n.y) << 10) | (asvoPackComponent(n.z) << 20);
  return uvec2(x | (y << 8) | (z << 16) | (v.z & 0xff000000u), normal | asvoConeMark(v));
}

/// Radiance that a side sends out: reflectance / pi times its irradiance, packed.
uint asvoConeLight(vec3 reflectance, uint irradiance) ASVO_READS {
  return asvoPackRgb9e5(reflectance * asvoUnpackRgb9e5(irradiance) * kAsvoInvPi);
}

/// All that a cone reads of a voxel. `v`: its words; `light`: irradiance, of which a cone takes
/// that of the voxel as a whole, as it meets all of its faces together. x: extinction along the
/// axes (8 bits each) and the plane; y: normal, 3 x 10 bits; z, w: radiance of front and back.
uvec4 asvoConeWords(uvec4 v, uvec4 light) ASVO_READS {
  uvec2 shape = asvoConeShape(v);
  vec3 albedo = asvoUnpackAlbedo(v.z);
  return uvec4(shape, asvoConeLight(albedo, light.z), asvoConeLight(albedo, light.w));
}

// Defined as false, it leaves out what lies below the grid: for cones that start wider
// (asvoStartsWide).
#ifndef ASVO_FINE
#define ASVO_FINE true
#endif

#ifndef ASVO_CONE
#define ASVO_CONE(i) asvoConeWords(ASVO_VOXEL(i), ASVO_LIGHT(i))
#endif
#ifndef ASVO_CONE_FINE
#define ASVO_CONE_FINE(i) ASVO_CONE(i)
#endif
