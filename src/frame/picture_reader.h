// Reading picture files back, for comparison and merging.
#pragma once

#include <filesystem>

#include "src/frame/image_file.h"

namespace trex {

/// Reads the first image of an .exr, .png, .jpg or .hdr file, all channels as linear floats with
/// the names the file gives them; a single grey channel becomes R, G and B. Colours of a .png or
/// .jpg are decoded from sRGB. Metadata whose key starts with "trex:" is kept, as text.
///
/// The file may be hostile: sizes are checked before anything is allocated, and memory is taken
/// only as rows really come. Throws Error(kInput) naming the file if it is missing, of another
/// format, broken, cut short, or larger than 65536 pixels a side or 32 GiB of floats;
/// Error(kMemoryOrDevice) if it needs more than the machine has. Thread safe: one file is decoded
/// at a time.
Picture readPicture(const std::filesystem::path& path);

/// The value of a key; empty if there is none.
std::string metadataOf(const Picture& picture, const std::string& key);

/// Whether a render says of its picture that its noise was taken already.
bool isDenoised(const Picture& picture);

/// Number of the channel of that name in the picture, or -1.
int channelIndex(const Picture& picture, const std::string& name);

}  // namespace trex
