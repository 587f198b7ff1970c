// Albedos of a diffuse ground under a smooth interface, as other renderers model it, against the
// diffuse lobe of a material here: what its base colour must be for the same light.
#pragma once

namespace trex::detail {

/// Mean over all pairs of directions, weighted by both cosines, of the share 1 - F(half vector)
/// that a material's interface of this index leaves to its diffuse lobe; F by Schlick.
double diffuseShare(double ior);

/// The diffuse part of a plastic [Mitsuba's `plastic`]: light that enters, is scattered by a
/// ground of the given reflectance, and leaves, with what is reflected inside on the way.
class PlasticGround {
 public:
  /// `nonlinear`: the colour shifts with each inner reflection.
  PlasticGround(double ior, bool nonlinear);

  /// Share of light from everywhere that leaves by the diffuse part.
  double albedo(double reflectance) const;
  /// The base colour with that albedo, at most 1.
  double baseColor(double reflectance) const;

 private:
  double enters_, leavesInner_, share_;
  bool nonlinear_;
};

/// Albedo of Disney's diffuse lobe [Burley 2012] of a base colour of 1.
double disneyDiffuseAlbedo(double roughness);

}  // namespace trex::detail
