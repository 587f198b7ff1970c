// Compiled once for each instruction set [Highway's foreach_target]. Formulas are those of
// ray_scene_surface.cpp, bsdf.cpp and microfacet.h, term by term; plain_lanes_test.cpp compares.
#include "src/crays/plain_lanes.h"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "src/crays/plain_lanes.cpp"
#include <hwy/foreach_target.h>
#include <hwy/highway.h>

#include "src/crays/lanes-inl.h"

#ifndef TREX_PLAIN_LANES_ONCE
#define TREX_PLAIN_LANES_ONCE
#include <algorithm>
#include <cmath>

namespace trex {
namespace {

/// Of what is seen of a surface, see Bsdf::seen().
constexpr float kLeastCosine = 1e-3f;
/// Corners that look elsewhere speak of no smooth surface; they do of a flat one.
constexpr double kLeastLifted = 0.3, kFlat = 1.0 - 1e-9;

}  // namespace
void cosinesAndSines(const float* angles, float* cosines, float* sines);
}  // namespace trex
#endif

HWY_BEFORE_NAMESPACE();
namespace trex {
namespace HWY_NAMESPACE {

// A vector of unit length, and whether it has one that is a plain number.
HWY_INLINE VD3 unit(const VD3& v, MD& sound) {
  const VD length2 = dot(v, v);
  sound = hn::And(sound, hn::And(hn::Gt(length2, set(1e-200)), hn::Lt(length2, set(1e200))));
  return v * (set(1.0) / hn::Sqrt(length2));
}

// By the normal matrix of a mesh that is not moved: what rounding and signs of zeros make of it.
HWY_INLINE VD3 byIdentity(const VD3& n) {
  const VD zero = set(0.0);
  return {n.x + n.y * zero + n.z * zero, n.x * zero + n.y + n.z * zero,
          n.x * zero + n.y * zero + n.z};
}

struct Normals {
  VD3 geometric, shading;
};

// The surface; its normals are on the triangle's front.
HWY_INLINE Normals shadeSurface(PlainLanes& l, std::size_t first, MD& sound) {
  VD3 p[3];
  for (int i = 0; i < 3; ++i) p[i] = widen(load(l.corner[i], first));
  const VD u = load(l.u + first), v = load(l.v + first), w = set(1.0) - u - v;
  const VD3 e1 = p[1] - p[0], e2 = p[2] - p[0];
  const VD3 position = p[0] + e1 * u + e2 * v;
  store(position, l.position, first);
  const VD3 normal = unit(cross(e1, e2), sound);
  Normals n{normal, normal};
  const VD none = set(0.0);
  VD3 lift[2] = {{none, none, none}, {none, none, none}};
  VD bend = none;
  if ((l.smooth >> first & ((1u << kWidth) - 1u)) != 0) {
    const MD smooth = maskD(l.smooth, first);
    VD3 corner[3];
    for (int i = 0; i < 3; ++i) corner[i] = widen(load(l.cornerNormal[i], first));
    MD known = sound;
    const VD3 mixed = unit(byIdentity(corner[0] * w + corner[1] * u + corner[2] * v), known);
    const VD side = select(hn::Lt(dot(mixed, normal), none), set(-1.0), set(1.0));
    VD lowest = set(1.0);
    const VD weights[3] = {w, u, v};
    for (int i = 0; i < 3; ++i) {
      const VD3 direction = unit(byIdentity(corner[i]), known) * side;
      lowest = least(lowest, dot(direction, normal));
      const VD height = dot(position - p[i], direction);
      const VD3 by = direction * (weights[i] * height);
      const MD below = hn::Lt(height, none);
      lift[0] = select(below, lift[0] - by, lift[0]);
      lift[1] = select(below, lift[1], lift[1] - by);
    }
    const MD lifts =
        hn::And(smooth, hn::And(hn::Gt(lowest, set(kLeastLifted)), hn::Le(lowest, set(kFlat))));
    for (VD3& one : lift) one = select(lifts, one, VD3{none, none, none});
    bend = select(lifts, hn::Sqrt(set(1.0) - lowest * lowest), none);
    n.shading = select(smooth, mixed * side, normal);
    sound = hn::And(sound, hn::Or(known, hn::Not(smooth)));
  }
  store(narrow(lift[0]), l.lift[0], first);
  store(narrow(lift[1]), l.lift[1], first);
  store(narrow(bend), l.bend + first);
  return n;
}

HWY_INLINE VF luminanceOf(const VF3& c) {
  return set(0.2126f) * c.x + set(0.7152f) * c.y + set(0.0722f) * c.z;
}

// The frame around the normal [Duff et al. 2017], as Basis.
HWY_INLINE void frame(const VF3& n, VF3& tangent, VF3& bitangent) {
  const VF one = set(1.0f), sign = hn::CopySign(one, n.z);
  const VF a = set(-1.0f) / (sign + n.z);
  const VF b = n.x * n.y * a;
  tangent = {one + sign * n.x * n.x * a, sign * b, hn::Neg(sign) * n.x};
  bitangent = {b, sign + n.y * n.y * a, hn::Neg(n.y)};
}

HWY_INLINE VF lambda(VF cosine, VF alpha) {
  const VF c2 = cosine * cosine, one = set(1.0f);
  const VF tan2 = (one - c2) / most(c2, set(1e-14f));
  return set(0.5f) * (hn::Sqrt(one + alpha * alpha * most(tan2, set(0.0f))) - one);
}

// Of a plain surface's lobes, as far as directions ask for them.
struct Lobes {
  VF3 out, diffuse, color, f0;
  VF f90, metallic, alpha, masked, diffuseLobe, specularLobe;
  MF lambertian;

  HWY_INLINE Lobes(const PlainLanes& l, std::size_t first)
      : out(load(l.out, first)),
        diffuse(load(l.diffuse, first)),
        color(load(l.color, first)),
        f0(load(l.f0, first)),
        f90(load(l.f90 + first)),
        metallic(load(l.metallic + first)),
        alpha(load(l.alpha + first)),
        masked(load(l.masked + first)),
        diffuseLobe(load(l.diffuseLobe + first)),
        specularLobe(load(l.specularLobe + first)),
        lambertian(maskF(l.lambertian, first)) {}
};

HWY_INLINE VF3 reflectance(const VF3& f0, VF f90, const VF3& color, VF metallic, VF cosine,
                           VF& interface) {
  const VF one = set(1.0f);
  const VF away = one - cosine;
  const VF x = select(hn::Lt(away, set(0.0f)), set(0.0f), select(hn::Lt(one, away), one, away));
  const VF weight = x * x * x * x * x;
  const VF3 dielectric = {f0.x + (f90 - f0.x) * weight, f0.y + (f90 - f0.y) * weight,
                          f0.z + (f90 - f0.z) * weight};
  interface = most(dielectric.x, most(dielectric.y, dielectric.z));
  const VF rest = one - metallic;
  return {dielectric.x * rest + color.x * metallic, dielectric.y * rest + color.y * metallic,
          dielectric.z * rest + color.z * metallic};
}

void shadePart(PlainLanes& l, std::size_t first) {
  const VF zero = set(0.0f), one = set(1.0f);
  MD sound = hn::Eq(set(0.0), set(0.0));
  const Normals normals = shadeSurface(l, first, sound);
  l.odd |= bitsOf(DD(), hn::Not(sound), first);
  const VF3 geometric = narrow(normals.geometric), shading = narrow(normals.shading);
  store(geometric, l.geometricNormal, first);

  const VF3 outgoing = negative(load(l.direction, first));
  const MF front = hn::Ge(dot(geometric, outgoing), zero);
  l.front |= bits(front, first);
  const VF3 facing = select(front, geometric, negative(geometric));
  const VF3 ours = select(front, shading, negative(shading));
  VF3 normal = ours;
  const VF cosine = dot(normal, outgoing);
  const MF unseen = hn::Not(hn::Ge(cosine, set(kLeastCosine)));
  if (!hn::AllFalse(DF(), unseen)) {
    normal = select(unseen, normalize(normal + outgoing * (set(kLeastCosine) - cosine)), normal);
  }
  normal = select(hn::Le(dot(normal, facing), zero), facing, normal);
  const VF3 lift = select(front, load(l.lift[0], first), load(l.lift[1], first));
  const MF lifts = hn::Or(hn::Ne(lift.x, zero), hn::Or(hn::Ne(lift.y, zero), hn::Ne(lift.z, zero)));
  store(facing, l.facing, first);
  store(select(lifts, ours, facing), l.smoothNormal, first);
  VF3 tangent, bitangent;
  frame(normal, tangent, bitangent);
  VF3 out = {dot(outgoing, tangent), dot(outgoing, bitangent), dot(outgoing, normal)};
  out.z = most(out.z, set(1e-6f));
  store(normal, l.normal, first);
  store(tangent, l.tangent, first), store(bitangent, l.bitangent, first);
  store(out, l.out, first);

  const VF3 color = load(l.color, first), f0 = load(l.f0, first);
  const VF f90 = load(l.f90 + first), metallic = load(l.metallic + first),
           alpha = load(l.alpha + first);
  const VF3 diffuse = color * (one - metallic);
  store(diffuse, l.diffuse, first);
  const MF lambertian =
      hn::And(hn::And(hn::Eq(f0.x, zero), hn::And(hn::Eq(f0.y, zero), hn::Eq(f0.z, zero))),
              hn::And(hn::Eq(f90, zero), hn::Eq(metallic, zero)));
  l.lambertian |= bits(lambertian, first);
  store(select(lambertian, zero, lambda(out.z, alpha)), l.masked + first);
  VF interface;
  const VF3 seen = reflectance(f0, f90, color, metallic, out.z, interface);
  VF specularLobe = select(lambertian, zero, luminanceOf(seen));
  interface = select(lambertian, zero, interface);
  VF diffuseLobe = luminanceOf(diffuse) * (one - interface);
  const VF sum = specularLobe + diffuseLobe;
  const MF some = hn::Gt(sum, zero);
  diffuseLobe = select(hn::And(some, hn::Gt(diffuseLobe, zero)), diffuseLobe / sum, diffuseLobe);
  specularLobe =
      select(hn::And(some, hn::Gt(specularLobe, zero)), specularLobe / sum, specularLobe);
  store(diffuseLobe, l.diffuseLobe + first), store(specularLobe, l.specularLobe + first);
}

void shade(PlainLanes& l) {
  l.front = l.lambertian = l.odd = 0;
  for (std::size_t first = 0; first < PlainLanes::kLanes; first += kWidth) shadePart(l, first);
}

struct Value {
  VF3 f;
  VF pdf;
};

// Of a local direction above the horizon of the normal, as Bsdf::reflection().
HWY_INLINE Value reflection(const Lobes& b, const VF3& in) {
  const VF zero = set(0.0f), one = set(1.0f), inversePi = set(kInvPi);
  const VF lit = inversePi * in.z;
  Value value{b.diffuse * lit, b.diffuseLobe * in.z * inversePi};
  if (hn::AllTrue(DF(), b.lambertian)) return value;
  const VF3 half = normalize(b.out + in);
  const VF cosine = dot(b.out, half);
  const VF a2 = b.alpha * b.alpha, c2 = half.z * half.z;
  const VF d = a2 * c2 + (one - c2);
  const VF density = select(hn::Le(half.z, zero), zero, a2 / (set(kPi) * d * d));
  VF interface;
  const VF3 reflected = reflectance(b.f0, b.f90, b.color, b.metallic, cosine, interface);
  const VF masking = one / (one + b.masked + lambda(in.z, b.alpha));
  const VF3 specular = reflected * (density * masking / (set(4.0f) * b.out.z));
  const VF3 both = specular + b.diffuse * ((one - interface) * inversePi * in.z);
  const VF3 f = select(hn::Gt(b.diffuseLobe, zero), both, specular);
  const VF visible = one / (one + b.masked) * most(cosine, zero) * density / b.out.z;
  const VF more = b.specularLobe * visible / (set(4.0f) * cosine);
  const VF pdf = select(hn::Gt(b.specularLobe, zero), value.pdf + more, value.pdf);
  return {select(b.lambertian, value.f, f), select(b.lambertian, value.pdf, pdf)};
}

HWY_INLINE MF aboveHorizon(const PlainLanes& l, std::size_t first, const VF3& direction) {
  const VF zero = set(0.0f);
  return hn::Or(hn::Gt(dot(direction, load(l.facing, first)), zero),
                hn::Gt(dot(direction, load(l.smoothNormal, first)), zero));
}

void value(const PlainLanes& l, PlainValues& values) {
  const VF zero = set(0.0f);
  const VF3 none = {zero, zero, zero};
  for (std::size_t first = 0; first < PlainLanes::kLanes; first += kWidth) {
    const VF3 incoming = load(values.direction, first);
    const VF3 in = {dot(incoming, load(l.tangent, first)), dot(incoming, load(l.bitangent, first)),
                    dot(incoming, load(l.normal, first))};
    const MF above = hn::Gt(in.z, zero);
    const Value all = reflection(Lobes(l, first), in);
    store(select(hn::And(above, aboveHorizon(l, first, incoming)), all.f, none), values.f, first);
    store(select(above, all.pdf, zero), values.pdf + first);
  }
}

// A micro normal seen from `out` [Heitz 2018], as ggxSampleVisible().
HWY_INLINE VF3 visibleNormal(const VF3& out, VF alpha, VF r, VF cosine, VF sine) {
  const VF zero = set(0.0f), one = set(1.0f);
  const VF3 stretched = normalize({alpha * out.x, alpha * out.y, out.z});
  const VF length2 = stretched.x * stretched.x + stretched.y * stretched.y;
  const VF3 across = VF3{hn::Neg(stretched.y), stretched.x, zero} / hn::Sqrt(length2);
  const VF3 t1 = select(hn::Gt(length2, zero), across, VF3{one, zero, zero});
  const VF3 t2 = cross(stretched, t1);
  const VF x = r * cosine, blend = set(0.5f) * (one + stretched.z);
  const VF y = (one - blend) * hn::Sqrt(most(zero, one - x * x)) + blend * r * sine;
  const VF z = hn::Sqrt(most(zero, one - x * x - y * y));
  const VF3 n = t1 * x + t2 * y + stretched * z;
  return normalize({alpha * n.x, alpha * n.y, most(n.z, set(1e-7f))});
}

void samplePart(const PlainLanes& l, PlainSamples& s, std::size_t first, const float* cosines,
                const float* sines) {
  const VF zero = set(0.0f), one = set(1.0f);
  const Lobes b(l, first);
  const VF choice = load(s.choice + first), u = load(s.u + first);
  const VF r = hn::Sqrt(u), cosine = load(cosines + first), sine = load(sines + first);
  const MF diffuse = hn::Lt(choice, b.diffuseLobe);
  MF found = hn::Or(diffuse, hn::Lt(choice, b.diffuseLobe + b.specularLobe));
  VF3 local = {r * cosine, r * sine, hn::Sqrt(most(zero, one - u))};
  if (!hn::AllTrue(DF(), diffuse)) {
    const VF3 micro = visibleNormal(b.out, b.alpha, r, cosine, sine);
    const VF3 mirrored = normalize(micro * (set(2.0f) * dot(b.out, micro)) - b.out);
    local = select(diffuse, local, mirrored);
  }
  found = hn::And(found, hn::Gt(local.z, zero));
  const VF3 direction = load(l.tangent, first) * local.x + load(l.bitangent, first) * local.y +
                        load(l.normal, first) * local.z;
  const Value value = reflection(b, local);
  found = hn::And(found, hn::And(aboveHorizon(l, first, direction), hn::Gt(value.pdf, zero)));
  s.found |= bits(found, first);
  store(direction, s.direction, first);
  store(value.f / value.pdf, s.weight, first);
  store(value.pdf, s.pdf + first);
  store(select(diffuse, one, b.alpha), s.roughness + first);
}

void sample(const PlainLanes& l, PlainSamples& s) {
  PlainLanes::Floats angles, cosines, sines;
  for (std::size_t i = 0; i < PlainLanes::kLanes; ++i) angles[i] = 2.0f * kPi * s.v[i];
  cosinesAndSines(angles, cosines, sines);
  s.found = 0;
  for (std::size_t first = 0; first < PlainLanes::kLanes; first += kWidth)
    samplePart(l, s, first, cosines, sines);
}

const PlainKernels* plainKernels() {
  static const PlainKernels all = {shade, value, sample};
  return &all;
}

}  // namespace HWY_NAMESPACE
}  // namespace trex
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace trex {
void cosinesAndSines(const float* angles, float* cosines, float* sines) {
  for (std::size_t i = 0; i < PlainLanes::kLanes; ++i) {
    cosines[i] = std::cos(angles[i]);
    sines[i] = std::sin(angles[i]);
  }
}
HWY_EXPORT(plainKernels);
const PlainKernels* choosePlainKernels() {
  hwy::GetChosenTarget().Update(hwy::SupportedTargets());
  return HWY_DYNAMIC_DISPATCH(plainKernels)();
}
}  // namespace trex
#endif
