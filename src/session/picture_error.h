// How far a denoised picture with a dial is from the truth: noise and bias, from the frame alone.
#pragma once

#include "src/session/frame_buffers.h"
#include "src/session/shown_picture.h"

namespace trex {

/// Estimated relMSE (as Accumulator::estimatedError()) of the picture that a capture's frame with a
/// dial shows by the filter; Open Image Denoise is seldom worse, and takes longer to ask. It is the
/// sum of
///
///   the error of the denoised guess against the guess without noise. Its noise N is found by one
///   more run of the filter on light that is changed by another draw of its noise (LightNoise, a
///   bootstrap that knows how rare and bright samples are), scaled to the noise that samples have,
///   as they are stratified. What the filter leaves of its input it shares between neighbours as
///   far as it is error of its own: the mean product of neighbours is the square of the filter's
///   bias less N, as in Stein's unbiased risk estimate. Detail within two pixels is not seen so: a
///   constant stands for it;
///
///   the bias that is left after the correction, and the correction's noise: MeasuredCorrection.
///   What photons have left in the light that samples read is known without pairs: PhotonNoise.
///
/// Infinite while there are too few samples or pairs to tell. Takes as long as four runs of the
/// filter.
double estimatePictureError(const FrameBuffers& frame);

}  // namespace trex
