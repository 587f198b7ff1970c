// What a frame shows: means, filtered if asked for. Capture and screen share it, so that they show
// the same pixels.
#pragma once

#include <functional>
#include <optional>
#include <vector>

#include "src/frame/denoise.h"
#include "src/frame/lattice_light.h"
#include "src/session/denoiser.h"
#include "src/session/frame_buffers.h"
#include "src/session/lattice_features.h"
#include "src/session/measured_correction.h"

namespace trex {

/// Pairs of a pixel, on average, from which on a correction is looked for.
inline constexpr double kPairsThatTell = 0.5;

struct ShownOptions {
  DenoiseMethod method = DenoiseMethod::kOff;
  bool pairs = false;  ///< the frame keeps differences
  /// Every so manieth pixel alone, each of which must have a sample; 1: all of them, and where one
  /// has none yet that of its lattice before it.
  std::uint32_t spacing = 1;
  /// All of them all the same: the light of that lattice, of every second pixel at least, and of
  /// what samples there are between, is filtered and spread by what each pixel shows, as looks know
  /// it. Better while samples are few, and pixels many.
  bool spread = false;
  std::uint32_t shown = 1;  ///< then: every so manieth pixel alone, each of which must have a look
  bool keepGuess = false;   ///< guessLight() will be asked for
};

/// The light of a whole frame, denoised: `features` are the frame's, or like them. Throws as
/// ShownPicture does.
std::vector<vec3> denoiseFrame(const FrameBuffers& frame, const FeatureImage& features,
                               DenoiseMethod method);

/// One picture under way, of the frame as it was when this was made; to be spread or corrected
/// the frame must outlive it, and may get more samples, but not begin anew. One thread at a time.
class ShownPicture {
 public:
  /// Open Image Denoise, which can't be interrupted, does its part here; Error(kMemoryOrDevice) if
  /// it fails.
  ShownPicture(const FrameBuffers& frame, std::uint32_t width, std::uint32_t height,
               const ShownOptions& options);
  /// Works until done or keepGoing() says no, asked about every millisecond. True once done.
  bool advance(const std::function<bool()>& keepGoing);
  /// Once advance() is true: row by row, ceil(width / spacing) wide, or if spread / shown.
  std::vector<vec3> take() { return std::move(picture_); }
  /// Once advance() is true: what the correction leaves of the bias; none if there are too few
  /// pairs to tell.
  const std::optional<BiasLeft>& biasLeft() const { return biasLeft_; }
  /// The guess's denoised light, without correction.
  const std::vector<vec3>& guessLight() const { return guessLight_; }

 private:
  void gather(const FrameBuffers& frame, std::uint32_t width, std::uint32_t height,
              const ShownOptions& options);
  void addMissing(const FrameBuffers& frame);
  void takeIn(std::size_t pixel, const vec3& part);
  bool addMeasured(MeasuredCorrection& correction, const std::function<bool()>& keepGoing);

  std::vector<vec3> picture_;  ///< until done, what is not filtered
  std::vector<vec3> lit_;      ///< what is filtered
  double missing_ = 0.0;       ///< sum of the differences to exact paths that lit_ is without
  double doubt_ = 0.0;         ///< with a dial: its variance
  std::optional<BiasLeft> biasLeft_;
  bool keepGuess_ = false;
  std::vector<vec3> guessLight_;
  std::vector<float> scattering_;            ///< shares of the pixels that the correction is of
  std::optional<LatticeFeatures> gathered_;  ///< of the lattice whose light is spread
  bool few_ = false;                         ///< samples, of it
  std::optional<GuessFilter> guess_;
  std::optional<FeatureImage> thin_;  ///< the lattice, once it is gathered
  std::optional<LatticeLight> spread_;
  const FeatureImage* all_ = nullptr;  ///< what spread_ is for
  std::uint32_t step_ = 1, shown_ = 1;
  std::optional<MeasuredCorrection> correction_;  ///< what exact paths add
  std::optional<MeasuredCorrection> lost_;        ///< what the guess's denoiser took too much
};

}  // namespace trex
