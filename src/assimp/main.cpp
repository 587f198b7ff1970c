#include "src/assimp/child.h"

#include <assimp/DefaultIOSystem.h>
#include <assimp/scene.h>
#include <unistd.h>

#include <assimp/Importer.hpp>
#include <cstdlib>
#include <cstring>
#include <memory>
#include <new>
#include <span>
#include <stdexcept>
#include <string>
#include <vector>

#include "src/assimp/convert.h"

namespace trex {
namespace {

/// Files of the disk, to read; keeps the names of those that were opened.
class Files : public Assimp::DefaultIOSystem {
 public:
  explicit Files(std::vector<std::string>& opened) : opened_(opened) {}
  Assimp::IOStream* Open(const char* file, const char* mode) override {
    if (std::strpbrk(mode, "wa+") != nullptr) return nullptr;
    Assimp::IOStream* stream = DefaultIOSystem::Open(file, mode);
    if (stream != nullptr) opened_.emplace_back(file);
    return stream;
  }

 private:
  std::vector<std::string>& opened_;
};

int writeAll(int descriptor, std::span<const std::uint8_t> bytes, int code) {
  while (!bytes.empty()) {
    const ssize_t wrote = ::write(descriptor, bytes.data(), bytes.size());
    if (wrote <= 0) return kAssimpTooLarge;
    bytes = bytes.subspan(static_cast<std::size_t>(wrote));
  }
  return code;
}

int writeText(int descriptor, const std::string& text, int code) {
  return writeAll(descriptor, {reinterpret_cast<const std::uint8_t*>(text.data()), text.size()},
                  code);
}

/// Throws what assimp threw inside.
std::vector<std::uint8_t> readModel(const char* path) {
  Assimp::Importer importer;
  std::vector<std::string> files;
  importer.SetIOHandler(new Files(files));  // which the importer frees
  if (importer.ReadFile(path, 0) == nullptr) {
    if (importer.GetException()) std::rethrow_exception(importer.GetException());
    throw std::runtime_error(importer.GetErrorString());
  }
  const std::unique_ptr<aiScene> scene(importer.GetOrphanedScene());
  return gltfOf(*scene, std::move(files));
}

int run(const char* path, int descriptor) {
  try {
    const std::vector<std::uint8_t> bytes = readModel(path);
    return writeAll(descriptor, bytes, kAssimpRead);
  } catch (const std::bad_alloc&) {
    return kAssimpTooLarge;
  } catch (const std::length_error&) {
    return kAssimpTooLarge;
  } catch (const std::exception& e) {
    return writeText(descriptor, e.what(), kAssimpRefused);
  }
}

}  // namespace
}  // namespace trex

int main(int argc, char** argv) {
  if (argc != 3) return trex::kAssimpRefused;
  // What a damaged scene does when it is taken down is of no interest.
  std::_Exit(trex::run(argv[1], std::atoi(argv[2])));
}
