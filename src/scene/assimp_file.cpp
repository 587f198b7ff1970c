// Formats that assimp reads: a program beside this one does, and hands over binary glTF.
#include <fcntl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <csignal>
#include <cstring>

#include "src/assimp/child.h"
#include "src/core/child.h"
#include "src/core/memory.h"
#include "src/scene/import_detail.h"

namespace trex::detail {
namespace {

constexpr std::uint64_t kLeastBytes = 64u << 20;  ///< of memory, for assimp itself

/// Extensions, in lower case, of what assimp makes triangles of.
constexpr std::array kExtensions = {
    "3d",  "3ds",   "3mf",     "ac",  "ac3d", "acc",  "amf",  "ase", "ask",     "assbin",
    "b3d", "blend", "cob",     "dae", "dxf",  "enff", "fbx",  "hmp", "ifc",     "ifczip",
    "iqm", "irr",   "irrmesh", "lwo", "lws",  "lxo",  "md2",  "md3", "md5mesh", "mdc",
    "mdl", "mesh",  "ms3d",    "ndo", "nff",  "off",  "ogex", "pmx", "q3o",     "q3s",
    "sib", "smd",   "uc",      "vta", "x",    "x3d",  "x3db", "xgl", "zae",     "zgl"};

/// Of these the file tells the unit and what is up, or the format says it.
constexpr std::array kKnowTheirUnits = {"blend", "fbx",    "dae", "zae",
                                        "ifc",   "ifczip", "x3d", "x3db"};

template <std::size_t N>
bool among(const std::array<const char*, N>& list, const std::string& extension) {
  return std::any_of(list.begin(), list.end(), [&](const char* e) {
    return extension.size() > 1 && extension.substr(1) == e;
  });
}

/// In the child: becomes the reader. Nothing here is unsafe after fork().
[[noreturn]] void readAlone(char* const* words, int output, std::uint64_t memory,
                            std::uint64_t seconds) {
  becomeReader();
  limitProcess(RLIMIT_CPU, seconds);
  limitProcess(RLIMIT_DATA, memory);
  limitProcess(RLIMIT_FSIZE, memory);
  ::fcntl(output, F_SETFD, 0);  // this one is handed on
  ::execv(words[0], words);
  ::_exit(127);
}

int readInChild(const std::filesystem::path& path, std::uint64_t memory, int output) {
  const std::string program = besideProgram(kAssimpProgram).string(), name = path.string();
  const std::string descriptor = std::to_string(output);
  std::error_code error;
  const std::uint64_t seconds = readingSeconds(std::filesystem::file_size(path, error));
  const std::array<char*, 4> words = {const_cast<char*>(program.c_str()),
                                      const_cast<char*>(name.c_str()),
                                      const_cast<char*>(descriptor.c_str()), nullptr};
  const pid_t child = ::fork();
  if (child < 0) {
    fail(ExitCode::kMemoryOrDevice, "{}: no process to read it: {}", name, std::strerror(errno));
  }
  if (child == 0) readAlone(words.data(), output, memory, seconds);
  return waitForChild(child);
}

/// Throws what the child's end means, unless it has read the file.
void checkEnd(const std::string& name, int status, std::uint64_t memory, const MemoryFile& output) {
  if (WIFSIGNALED(status)) {
    const int signal = WTERMSIG(status);
    if (signal == SIGINT || signal == SIGTERM) {
      fail(static_cast<ExitCode>(128 + signal), "{}: interrupted while it was read", name);
    }
    if (signal == SIGXCPU) fail(ExitCode::kInput, "{}: assimp does not come to an end of it", name);
    if (signal != SIGXFSZ) {
      fail(ExitCode::kInput, "{}: is damaged: assimp crashed on it (signal {})", name, signal);
    }
  } else if (WEXITSTATUS(status) == kAssimpRead) {
    return;
  } else if (WEXITSTATUS(status) == 127) {
    fail(ExitCode::kMemoryOrDevice, "{}: can't be started to read it: build the target {}",
         besideProgram(kAssimpProgram).string(), kAssimpProgram);
  } else if (WEXITSTATUS(status) != kAssimpTooLarge) {
    const std::string reason = textOf(*output.map());
    fail(ExitCode::kInput, "{}: assimp can't read it: {}", name,
         reason.empty() ? "it does not say why" : reason);
  }
  fail(ExitCode::kMemoryOrDevice,
       "{}: assimp needs more than {} of memory for it; make --max-memory larger", name,
       formatBytes(memory));
}

}  // namespace

bool isAssimpExtension(const std::string& extension) { return among(kExtensions, extension); }

bool knowsItsUnit(const std::string& extension) { return among(kKnowTheirUnits, extension); }

Scene readAssimp(const std::filesystem::path& path, const ImportOptions& options) {
  const std::uint64_t limit = options.maxMemory > 0 ? options.maxMemory : availableMemoryLimit();
  const std::uint64_t here = residentBytes();
  const std::uint64_t memory = std::max(limit > here ? limit - here : 0, kLeastBytes);
  const MemoryFile output;
  checkEnd(path.string(), readInChild(path, memory, output.descriptor()), memory, output);
  const auto bytes = output.map();
  return readHandedOver({reinterpret_cast<const std::uint8_t*>(bytes->data()), bytes->size()}, path,
                        options);
}

}  // namespace trex::detail
