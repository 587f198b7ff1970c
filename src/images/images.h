// The calls into libtrex_images.so, which alone links OpenImageIO and its 250 libraries: the
// program opens that library when a file needs it (image_library.h), so that nothing else waits for
// them. Both sides are built together.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace trex {

enum class ImageValues { kByte, kWord, kHalf, kFloat };

/// What a part of a file says of itself.
struct ImageFileSpec {
  int width = 0, height = 0, depth = 1;  ///< of the data window, which begins at x, y
  int x = 0, y = 0, fullX = 0, fullY = 0, fullWidth = 0, fullHeight = 0;  ///< full: displayed
  int tileHeight = 0;                                                     ///< 0: rows
  bool deep = false;
  bool windowed = false;                     ///< an .exr: its two windows mean something
  ImageValues values = ImageValues::kFloat;  ///< that hold all of the file's
  bool floats = false;                       ///< the file's own are: linear
  std::vector<std::string> channels;
  std::vector<std::pair<std::string, std::string>> texts;  ///< of metadata

  bool cropped() const {
    return x != fullX || y != fullY || width != fullWidth || height != fullHeight;
  }
};

/// An open file. Parts are numbered from 0.
struct ImageFile;

/// Of one rectangle to write, rows from the top.
struct ImageToWrite {
  int width = 0, height = 0;
  ImageValues values = ImageValues::kByte;
  std::vector<std::string> channels{};  ///< named, for .exr; else R, G, B and perhaps A
  const void* data = nullptr;
  std::vector<std::pair<std::string, std::string>> texts{};  ///< metadata
  std::span<const float> chromaticities{};                   ///< none, or eight
  int jpegQuality = 0;                                       ///< 0: no JPEG
};

/// Errors are texts of OpenImageIO, and results then null or false. Thread safe if no two threads
/// use one file, but for decoding, which crashed now and then with OpenImageIO 2.4.7: one at a
/// time.
struct ImageFunctions {
  int version;  ///< of OpenImageIO: 20407 is 2.4.7
  /// `format`: OpenImageIO's name; empty: by the name of the file. Values keep their alpha apart if
  /// `apart`, else as the format has it.
  ImageFile* (*open)(const std::string& path, const std::string& format, bool apart,
                     std::string& error);
  /// Of a file in memory, which must outlive this one; the format by `name`. Alpha is apart.
  ImageFile* (*openMemory)(std::span<const std::uint8_t> file, const std::string& name,
                           std::string& error);
  void (*close)(ImageFile* file);
  /// False if there is no such part.
  bool (*spec)(ImageFile& file, int part, ImageFileSpec& out);
  /// Channels [begin, end) of a whole part; kWord: 16 bits of [0, 1].
  bool (*read)(ImageFile& file, int part, int begin, int end, ImageValues as, void* to,
               std::string& error);
  /// Rows [begin, end) of all channels of the first part, counted from 0, as floats; of tiled files
  /// `begin` is a multiple of the tile's height.
  bool (*readRows)(ImageFile& file, int begin, int end, float* to, std::string& error);
  /// .exr of floats, .jpg of bytes: the format by the path's extension.
  bool (*write)(const std::string& path, const ImageToWrite& image, std::string& error);
};

extern "C" const ImageFunctions* trexImageFunctions();
inline constexpr const char* kTrexImageFunctions = "trexImageFunctions";

}  // namespace trex
