#include "src/session/checkpoint.h"

#include <xxhash.h>

#include <algorithm>
#include <array>
#include <cstring>
#include <memory>

#include "src/core/error.h"
#include "src/core/file.h"

namespace trex {
namespace fs = std::filesystem;
namespace {

constexpr std::size_t kMostSamples = 16;

/// The first bytes of a file.
struct Head {
  char magic[8] = {'T', 'R', 'E', 'X', 'C', 'K', 'P', '2'};
  std::uint64_t payloadBytes = 0;  ///< of the sums, after this
  std::uint64_t key = 0;
  std::uint32_t frame = 0, samplesDone = 0, tilesDone = 0, errorCheck = 0;
  double renderSeconds = 0.0, error = 0.0, coneShare = 0.0;
  RayCounts rays;
  std::uint64_t nonFinite = 0;
  std::uint64_t nonFiniteListed = 0;
  NonFiniteSample nonFiniteSamples[kMostSamples] = {};
};
static_assert(std::is_trivially_copyable_v<Head>);
static_assert(sizeof(Head) == 8 * 5 + 8 * 3 + sizeof(RayCounts) + 8 * 2 + kMostSamples * 12,
              "no padding: every byte of a checkpoint is defined");

struct HashFree {
  void operator()(XXH3_state_t* state) const { XXH3_freeState(state); }
};

/// XXH3 of what passes by.
class Hash {
 public:
  Hash() : state_(XXH3_createState()) { XXH3_64bits_reset(state_.get()); }
  void add(const void* bytes, std::size_t size) { XXH3_64bits_update(state_.get(), bytes, size); }
  std::uint64_t value() const { return XXH3_64bits_digest(state_.get()); }

 private:
  std::unique_ptr<XXH3_state_t, HashFree> state_;
};

}  // namespace

void writeCheckpoint(const fs::path& path, const CheckpointHeader& header,
                     std::span<const std::span<std::byte>> parts) {
  Head head;
  for (const auto& part : parts) head.payloadBytes += part.size();
  head.key = header.key;
  head.frame = header.frame;
  head.samplesDone = header.samplesDone;
  head.tilesDone = header.tilesDone;
  head.errorCheck = header.errorCheck;
  head.renderSeconds = header.renderSeconds;
  head.error = header.error;
  head.coneShare = header.coneShare;
  head.rays = header.rays;
  head.nonFinite = header.nonFinite;
  head.nonFiniteListed = std::min(header.nonFiniteSamples.size(), kMostSamples);
  std::copy_n(header.nonFiniteSamples.begin(), head.nonFiniteListed, head.nonFiniteSamples);
  writeAtomically(path, [&](const fs::path& temporary) {
    std::ofstream file(temporary, std::ios::binary);
    Hash hash;
    const auto put = [&](const void* bytes, std::size_t size) {
      hash.add(bytes, size);
      file.write(static_cast<const char*>(bytes), static_cast<std::streamsize>(size));
    };
    put(&head, sizeof(head));
    for (const auto& part : parts) put(part.data(), part.size());
    const std::uint64_t sum = hash.value();
    file.write(reinterpret_cast<const char*>(&sum), sizeof(sum));
    file.close();
    if (!file) {
      fail(ExitCode::kOutput, "{}: can't be written: {}", path.string(), std::strerror(errno));
    }
  });
}

CheckpointReader::CheckpointReader(const fs::path& path)
    : path_(path), file_(path, std::ios::binary) {
  if (!file_) fail(ExitCode::kInput, "{}: can't be read: {}", path.string(), std::strerror(errno));
  Head head;
  std::error_code problem;
  const std::uint64_t size = fs::file_size(path, problem);
  const Head expected;
  file_.read(reinterpret_cast<char*>(&head), sizeof(head));
  if (!file_ || std::memcmp(head.magic, expected.magic, sizeof(head.magic)) != 0) {
    refuse("not a checkpoint of this version");
  }
  constexpr std::uint64_t kRest = sizeof(Head) + sizeof(std::uint64_t);
  if (problem || size < kRest || head.payloadBytes != size - kRest) refuse("it is cut short");
  if (!(head.coneShare >= 0.0 && head.coneShare <= 1.0)) refuse("its share of cones is none");
  if (head.nonFiniteListed > kMostSamples) refuse("its list of samples is too long");
  Hash hash;
  hash.add(&head, sizeof(head));
  std::vector<char> block(1u << 20);
  for (std::uint64_t left = head.payloadBytes; left > 0;) {
    const std::size_t count = static_cast<std::size_t>(std::min<std::uint64_t>(left, block.size()));
    if (!file_.read(block.data(), static_cast<std::streamsize>(count))) refuse("it is cut short");
    hash.add(block.data(), count);
    left -= count;
  }
  std::uint64_t sum = 0;
  file_.read(reinterpret_cast<char*>(&sum), sizeof(sum));
  if (!file_ || sum != hash.value()) refuse("its checksum is wrong");
  payloadBytes_ = head.payloadBytes;
  header_ = {
      .key = head.key,
      .frame = head.frame,
      .samplesDone = head.samplesDone,
      .tilesDone = head.tilesDone,
      .errorCheck = head.errorCheck,
      .renderSeconds = head.renderSeconds,
      .error = head.error,
      .coneShare = head.coneShare,
      .rays = head.rays,
      .nonFinite = head.nonFinite,
      .nonFiniteSamples = {head.nonFiniteSamples, head.nonFiniteSamples + head.nonFiniteListed}};
}

void CheckpointReader::read(std::span<const std::span<std::byte>> parts) {
  std::uint64_t wanted = 0;
  for (const auto& part : parts) wanted += part.size();
  if (wanted != payloadBytes_) refuse("it holds a frame of another size");
  file_.clear();
  file_.seekg(sizeof(Head));
  for (const auto& part : parts) {
    file_.read(reinterpret_cast<char*>(part.data()), static_cast<std::streamsize>(part.size()));
  }
  if (!file_) refuse("it can't be read to its end");
}

void CheckpointReader::refuse(const std::string& reason) const {
  fail(ExitCode::kInput, "{}: {}; remove it to start anew", path_.string(), reason);
}

}  // namespace trex
