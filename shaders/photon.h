// A photon's way through the ASVO, written once: GLSL, and C++ inside the body of a class derived
// from asvo::Tracer (src/grays/cpu_photons.h). Photon mapping [Jensen 1996] with one voxel side as
// the bin, Russian roulette by reflectance, and sums in fixed point.
//
// The including text provides the tracer's functions and
//   PHOTON_MATERIAL(i)              PhotonMaterial number i
//   PHOTON_MATERIAL_COUNT           how many there are
//   PHOTON_ADD_DIRECT(i, lo, hi)    adds hi * 2^32 + lo to 64-bit sum i of first hits
//   PHOTON_ADD_INDIRECT(i, lo, hi)  the same for all later hits
// Sum i = (leaf * 2 + side) * 3 + channel, side 0 is the front.
#ifndef TREX_PHOTON_H
#define TREX_PHOTON_H
#ifdef __cplusplus
#define PHOTON_INOUT(T) T&
#define PHOTON_CONST static constexpr
#define PHOTON_READS const
#else
#define PHOTON_INOUT(T) inout T
#define PHOTON_CONST const
#define PHOTON_READS
#endif

/// Distance by which a photon leaves its surface, in edges of a leaf voxel.
PHOTON_CONST float kStartOffset = 0.4f;

/// Keys of random numbers: (photon, bounce, dimension).
PHOTON_CONST uint kDimensionScatter = 0u;
PHOTON_CONST uint kDimensionRound = 1u;

/// A photon that has just arrived at a voxel and been deposited there.
struct PhotonPath {
  vec3 position;  // where it arrived, render space
  vec3 normal;    // unit, on the side it arrived at
  vec3 incoming;  // direction of flight before it arrived
  vec3 leave;     // the way off the surface that stays on the side of arrival, at most unit length
  vec3 power;     // W
  uint voxel;     // node of a leaf
  uint bounce;    // 0 at the first surface
  uint index;     // photon number
  bool alive;
  uint deposits, lost;
};

/// Counts of `watts`: rounded to a whole number, up with the probability of the fraction, so that
/// the mean of dim powers is right. A power that no sum can hold gives -1.
float photonCounts(float watts, float countsPerWatt, float random) PHOTON_READS {
  float counts = watts * countsPerWatt;
  if (!(counts >= 0.0f && counts < 4.0e18f)) return -1.0f;
  float whole = floor(counts);
  return random < counts - whole ? whole + 1.0f : whole;
}

/// Adds the photon's power to the side of its voxel that faces it.
void photonDeposit(PHOTON_INOUT(PhotonPath) path, float countsPerWatt) PHOTON_READS {
  vec3 random = randomUnit(path.index, path.bounce, kDimensionRound);
  vec3 counts = vec3(photonCounts(path.power.x, countsPerWatt, random.x),
                     photonCounts(path.power.y, countsPerWatt, random.y),
                     photonCounts(path.power.z, countsPerWatt, random.z));
  if (counts.x < 0.0f || counts.y < 0.0f || counts.z < 0.0f) {
    path.lost += 1u;
    path.alive = false;
    return;
  }
  uint side = dot(path.normal, asvoNormal(path.voxel)) >= 0.0f ? 0u : 1u;
  uint first = ((path.voxel - ASVO_INFO.firstLeaf) * 2u + side) * 3u;
  for (uint channel = 0u; channel < 3u; ++channel) {
    float value = channel == 0u ? counts.x : (channel == 1u ? counts.y : counts.z);
    // Both words are exact: a float has 24 bits, and 2^32 is a power of two.
    float high = floor(value * 2.3283064365386963e-10f);
    uint lowWord = uint(value - high * 4294967296.0f);
    if (path.bounce == 0u) {
      PHOTON_ADD_DIRECT(first + channel, lowWord, uint(high));
    } else {
      PHOTON_ADD_INDIRECT(first + channel, lowWord, uint(high));
    }
  }
  path.deposits += 1u;
}

/// Starts a path at a record and deposits its direct flux. A record off every voxel is lost.
PhotonPath photonBegin(PhotonRecord record, float countsPerWatt) PHOTON_READS {
  PhotonPath path;
  path.position = record.position;
  path.normal = asvoOctDecode(record.normal);
  path.incoming = -path.normal;
  path.leave = path.normal;
  path.power = record.power;
  path.bounce = (record.index & kLaterLanding) != 0u ? 1u : 0u;
  path.index = record.index & (kPhotonNumbers - 1u);
  path.deposits = 0u;
  path.lost = 0u;
  path.voxel = asvoFindNear(record.position, path.normal, ASVO_INFO.depth);
  path.alive = path.voxel != ASVO_NONE;
  if (path.alive) {
    photonDeposit(path, countsPerWatt);
    path.alive = path.alive && record.index < kLastLanding;
  } else {
    path.lost = 1u;
  }
  return path;
}

/// Cosine distributed about the unit vector n: a point on the unit sphere around its tip.
vec3 photonDiffuse(vec3 n, float u, float v) PHOTON_READS {
  float z = 1.0f - 2.0f * u;
  float r = sqrt(max(0.0f, 1.0f - z * z));
  float phi = 6.2831853f * v;
  vec3 d = n + vec3(r * cos(phi), r * sin(phi), z);
  float length2 = dot(d, d);
  return length2 > 1.0e-10f ? d * inversesqrt(length2) : n;
}

/// Mirrored about a GGX distributed half vector; kept above the surface so that no energy is lost.
vec3 photonMirror(vec3 incoming, vec3 n, float roughness, float u, float v) PHOTON_READS {
  float alpha = roughness * roughness;
  float cos2 = (1.0f - u) / (1.0f + (alpha * alpha - 1.0f) * u);
  float sinTheta = sqrt(max(0.0f, 1.0f - cos2));
  vec3 axis = abs(n.x) < 0.6f ? vec3(1.0f, 0.0f, 0.0f) : vec3(0.0f, 1.0f, 0.0f);
  vec3 tangent = normalize(cross(axis, n));
  float phi = 6.2831853f * v;
  vec3 h =
      n * sqrt(max(0.0f, cos2)) + (tangent * cos(phi) + cross(n, tangent) * sin(phi)) * sinTheta;
  vec3 d = incoming - h * (2.0f * dot(incoming, h));
  float above = dot(d, n);
  if (above <= 0.0f) d -= n * (2.0f * above - 1.0e-3f);
  return normalize(d);
}

/// Reflectance of the metal part of a voxel's material.
vec3 photonMetal(PhotonMaterial material) PHOTON_READS {
  vec3 base = vec3(float(material.baseColor & 255u), float(material.baseColor >> 8u & 255u),
                   float(material.baseColor >> 16u & 255u));
  return base * (material.metallic / 255.0f);
}

/// Scatters the photon and flies it to its next voxel, where it is deposited; or ends it: absorbed,
/// out of the cube, or after kMostPhotonBounces.
void photonStep(PHOTON_INOUT(PhotonPath) path, float countsPerWatt) PHOTON_READS {
  uint number = min(asvoMaterial(path.voxel), PHOTON_MATERIAL_COUNT - 1u);
  PhotonMaterial material = PHOTON_MATERIAL(number);
  vec3 diffuse = asvoAlbedo(path.voxel);
  vec3 metal = photonMetal(material);
  // The dominant material may cover a part of the voxel only: metal takes of what is not diffuse,
  // so that the sum stays below one and light shut in between surfaces dies out.
  metal *= 1.0f - max(diffuse.x, max(diffuse.y, diffuse.z));
  // A record does not tell where its photon came from: the metal part of the first surface scatters
  // like the rough surface it must be (smooth ones were followed by C-rays).
  if (path.bounce == 0u) {
    diffuse += metal;
    metal = vec3(0.0f);
  }
  float diffuseShare = max(diffuse.x, max(diffuse.y, diffuse.z));
  float metalShare = max(metal.x, max(metal.y, metal.z));

  vec3 random = randomUnit(path.index, path.bounce, kDimensionScatter);
  path.alive = random.x < diffuseShare + metalShare && path.bounce < kMostPhotonBounces;
  if (!path.alive) return;
  vec3 direction;
  if (random.x < diffuseShare) {
    path.power *= diffuse / diffuseShare;
    direction = photonDiffuse(path.normal, random.y, random.z);
  } else {
    path.power *= metal / metalShare;
    direction = photonMirror(path.incoming, path.normal, material.roughness, random.y, random.z);
  }

  // Leave by about a sub-voxel on the side of arrival: far enough to miss the own surface, near
  // enough not to step through the next.
  float edge = ASVO_INFO.size / float(1u << ASVO_INFO.depth);
  vec3 start = path.position + path.leave * (kStartOffset * edge);
  AsvoHit hit;
  path.alive = asvoIntersect(start, direction, 0.0f, 3.0e38f, hit);
  if (!path.alive) return;
  path.position = start + direction * hit.t;
  path.normal = hit.normal;
  path.incoming = direction;
  // A voxel without a plane holds several surfaces, and its mean normal may point behind the one
  // that was met: go back the way the photon came, which is known to be free.
  bool planar = asvoHasPlane(hit.voxel);
  path.leave = planar ? hit.normal : direction * -min(1.0f, hit.t / (kStartOffset * edge));
  path.voxel = hit.voxel;
  path.bounce += 1u;
  photonDeposit(path, countsPerWatt);
}

#endif
