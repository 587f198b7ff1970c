#include "src/core/hash.h"

#include <xxhash.h>

#include <cerrno>
#include <cstring>
#include <fstream>
#include <memory>
#include <vector>

#include "src/core/error.h"

namespace trex {

std::uint64_t hashFile(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) fail(ExitCode::kInput, "{}: can't be read: {}", path.string(), std::strerror(errno));
  const auto release = [](XXH3_state_t* state) { XXH3_freeState(state); };
  const std::unique_ptr<XXH3_state_t, decltype(release)> state(XXH3_createState(), release);
  XXH3_64bits_reset(state.get());
  std::vector<char> block(1u << 20);
  while (file.read(block.data(), static_cast<std::streamsize>(block.size())) || file.gcount() > 0) {
    XXH3_64bits_update(state.get(), block.data(), static_cast<std::size_t>(file.gcount()));
  }
  return XXH3_64bits_digest(state.get());
}

std::uint64_t hashText(std::string_view text) { return XXH3_64bits(text.data(), text.size()); }

}  // namespace trex
