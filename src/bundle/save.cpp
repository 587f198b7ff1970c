// From a model to the file of a bundle.
#include <fcntl.h>
#include <tbb/parallel_for.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>

#include "asvo/medium.h"
#include "src/bundle/arrays.h"
#include "src/bundle/bundle.h"
#include "src/bundle/describe.h"
#include "src/core/error.h"
#include "src/core/file.h"

namespace trex {
namespace {

namespace fs = std::filesystem;
using bundle::SectionData;

/// All sections of a file, and the arrays that were made for them.
class Sections {
 public:
  Sections(const Model& model, const BakeFacts& facts) {
    const Scene& scene = model.scene;
    const RayScene::Parts& parts = model.rays->parts();
    constexpr std::size_t kMost = std::size_t{1} << 19;
    if (parts.shared.size() > kMost || scene.images.size() > kMost) {
      fail(ExitCode::kInput, "{}: more than {} meshes or images; a bundle can't hold them",
           facts.input, kMost);
    }
    const bundle::Description description =
        bundle::describe(scene,
                         {parts.renderOrigin, static_cast<std::uint32_t>(parts.shared.size()),
                          parts.placed, model.voxels != nullptr},
                         facts);
    const std::string text = bundle::writeDescription(description);
    const auto bytes = std::as_bytes(std::span(text));
    add("scene.json", {bytes.begin(), bytes.end()});
    list_.push_back({"world.hccm", parts.world.bytes()});
    for (std::size_t i = 0; i < parts.shared.size(); ++i) {
      list_.push_back({fmt::format("mesh-{}.hccm", i), parts.shared[i].bytes()});
    }
    if (!description.emitters.empty()) {
      add("emitters.bin", bundle::packEmitters(description, scene.meshes));
    }
    for (std::size_t i = 0; i < scene.media.size(); ++i) {
      add(fmt::format("medium-{}.fog", i), scene.media[i].grid->toBytes());
    }
    if (model.voxels) add("voxels.asvo", model.voxels->toBytes());
    addImages(scene);
  }
  const std::vector<SectionData>& list() const { return list_; }

 private:
  void add(std::string name, std::vector<std::byte> bytes) {
    list_.push_back({std::move(name), bytes});
    owned_.push_back(std::move(bytes));
  }
  void addImages(const Scene& scene) {
    images_.resize(scene.images.size());
    tbb::parallel_for(std::size_t{0}, images_.size(),
                      [&](std::size_t i) { images_[i] = bundle::packImage(scene.images[i]); });
    for (std::size_t i = 0; i < images_.size(); ++i) {
      list_.push_back({fmt::format("image-{}.tiles", i), *images_[i]});
    }
    if (scene.environment.map) {
      add("environment.zst", bundle::packMap(*scene.environment.map));
    }
  }

  std::vector<SectionData> list_;
  std::vector<std::vector<std::byte>> owned_;  ///< a move keeps where their bytes are
  std::vector<std::shared_ptr<const std::span<const std::byte>>> images_;
};

/// A file written from front to back.
class Output {
 public:
  Output(const fs::path& path, std::string name)
      : name_(std::move(name)),
        file_(::open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666)) {
    if (file_ < 0) failed();
  }
  ~Output() { ::close(file_); }
  Output(const Output&) = delete;
  Output& operator=(const Output&) = delete;
  void write(std::span<const std::byte> bytes) {
    while (!bytes.empty()) {
      const ssize_t got = ::write(file_, bytes.data(), bytes.size());
      if (got < 0 && errno == EINTR) continue;
      if (got <= 0) failed();
      bytes = bytes.subspan(static_cast<std::size_t>(got));
    }
  }

 private:
  [[noreturn]] void failed() const {
    fail(ExitCode::kOutput, "{}: can't be written: {}", name_, std::strerror(errno));
  }
  std::string name_;
  int file_;
};

}  // namespace

std::vector<bundle::Section> saveBundle(
    const fs::path& target, const Model& model, const BakeFacts& facts,
    const std::function<bool(std::uint64_t, std::uint64_t)>& written) {
  constexpr std::size_t kChunk = std::size_t{8} << 20;
  const Sections sections(model, facts);
  const std::uint64_t total = bundle::containerBytes(sections.list());
  writeAtomically(target, [&](const fs::path& temporary) {
    Output file(temporary, target.string());
    std::uint64_t done = 0;
    bundle::writeContainer(sections.list(), [&](std::span<const std::byte> bytes) {
      for (; !bytes.empty(); bytes = bytes.subspan(std::min(kChunk, bytes.size()))) {
        file.write(bytes.first(std::min(kChunk, bytes.size())));
        done += std::min(kChunk, bytes.size());
        if (!written(done, total)) {
          fail(ExitCode::kInterrupted, "{}: interrupted; nothing was written", target.string());
        }
      }
    });
  });
  std::vector<bundle::Section> out;
  std::uint64_t offset = bundle::kAlignment;
  for (const SectionData& s : sections.list()) {
    out.push_back({s.name, offset, s.bytes.size()});
    offset += (s.bytes.size() + bundle::kAlignment - 1) / bundle::kAlignment * bundle::kAlignment;
  }
  return out;
}

std::vector<std::byte> bundleBytes(const Model& model, const BakeFacts& facts) {
  const Sections sections(model, facts);
  std::vector<std::byte> out;
  out.reserve(bundle::containerBytes(sections.list()));
  bundle::writeContainer(sections.list(), [&](std::span<const std::byte> bytes) {
    out.insert(out.end(), bytes.begin(), bytes.end());
  });
  return out;
}

}  // namespace trex
