// Opens libtrex_images.so, which lies beside the program.
#pragma once

#include <memory>
#include <mutex>
#include <thread>

#include "src/images/images.h"

namespace trex {

/// Opens the library at the first call. Throws Error(kMemoryOrDevice) if it can't be. Thread safe.
const ImageFunctions& imageLibrary();

/// Opens it in a thread of its own, while this one goes on to what needs it later. Throws at once
/// if there is no such file; imageLibrary() throws what else is wrong. Not while others fork().
std::jthread openImageLibraryBehind();

/// One at a time: see ImageFunctions.
std::mutex& imageDecoding();

struct CloseImageFile {
  void operator()(ImageFile* file) const { imageLibrary().close(file); }
};
using OpenImageFile = std::unique_ptr<ImageFile, CloseImageFile>;

}  // namespace trex
