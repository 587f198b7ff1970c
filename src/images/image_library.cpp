#include "src/images/image_library.h"

#include <filesystem>

#include "src/core/child.h"
#include "src/core/error.h"
#include "src/core/module.h"

namespace trex {
namespace {

constexpr const char* kFile = "libtrex_images.so";

}  // namespace

const ImageFunctions& imageLibrary() {
  static const ImageFunctions* const found =
      moduleFunction<decltype(trexImageFunctions)>(kFile, kTrexImageFunctions, "OpenImageIO")();
  return *found;
}

std::jthread openImageLibraryBehind() {
  if (!std::filesystem::exists(besideProgram(kFile))) imageLibrary();
  return std::jthread([] {
    try {
      imageLibrary();
    } catch (const Error&) {  // thrown again to whom it concerns
    }
  });
}

std::mutex& imageDecoding() {
  static std::mutex mutex;
  return mutex;
}

}  // namespace trex
