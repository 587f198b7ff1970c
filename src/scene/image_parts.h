// What the decoders of images share: where the colours of a file are, and where they lie.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>

#include "src/images/image_library.h"
#include "src/scene/scene.h"

namespace trex::detail {

/// Where the colours of a file are: one of its parts, and their first channel there.
struct Colors {
  int part = 0, channel = 0;
  std::string layer;  ///< "ViewLayer.Combined", or empty
  int channels = 3;   ///< 1: grey; 4: with alpha behind
};

ImageFileSpec specOf(ImageFile& file, int part);

/// The picture itself before any layer; of layers the one with all light, or else the first; or
/// grey. Nothing if there are no colours by their names. Alpha is one of them if `alpha`.
std::optional<Colors> findColors(ImageFile& file, const std::string& name, bool alpha);

/// Throws Error(kInput) if what is displayed of a part is larger than `maxSide`, or no picture.
void checkSize(const ImageFileSpec& spec, const std::string& name, std::int64_t maxSide);

/// Reads channels of a part into its displayed window, whose other texels are 0; files other than
/// .exr have one window. Throws Error(kInput) if it is cut off or broken.
void readWindow(ImageFile& file, const Colors& at, const ImageFileSpec& spec, ImageValues as,
                const std::string& name, std::byte* to);

/// Gives a part the size that is displayed of it.
void setSize(const ImageFileSpec& spec, Image& image);

/// Throws Error(kMemoryOrDevice) if this many bytes are not left of `maxMemory` (0: the machine's).
void checkRoom(std::uint64_t bytes, const std::string& name, std::uint64_t maxMemory);

}  // namespace trex::detail
