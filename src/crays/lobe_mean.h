// What lobes do to light that comes from everywhere alike: albedos by direction.
#pragma once

namespace trex {

/// Of a GGX lobe seen under a cosine: with Fresnel's reflectance F it sends back
/// energy * F(cosine).
struct LobeMean {
  float energy;  ///< that of F = 1, [0, 1]: scattering between microfacets is not modelled
  float cosine;  ///< at which Schlick's weight is its mean over the lobe
};

/// alpha = roughness^2, [0, 1]; cosine in [0, 1]. Within 0.005. The first call makes a table, in a
/// few milliseconds. Thread safe.
LobeMean ggxMean(float cosine, float alpha);

/// The cosine to the half vector at which Schlick's weight is its mean over all directions of
/// arriving light, weighted by their cosines, for a surface seen under `cosine`. Thread safe.
float diffuseMeanCosine(float cosine);

/// Mean of Schlick's weight at the lower of two directions: the one seen, and all of arriving
/// light, weighted by their cosines.
float lowerMeanWeight(float cosine);

}  // namespace trex
