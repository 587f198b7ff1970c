// Who a machine is: what must be the same everywhere for pictures to have the same bits.
#pragma once

#include <filesystem>
#include <string>

#include "src/machines/messages.h"

namespace trex::machines {

/// Of this process. `threads`: that it traces with. `program`: the file that must be the same on
/// all, by default the one that runs.
Hello helloOfThis(std::uint32_t threads, const std::filesystem::path& program = "/proc/self/exe");

/// What another machine's greeting says that makes it unfit: another version or build. Empty if
/// nothing.
std::string whyUnfit(const Hello& mine, const Hello& other);

/// "AVX2 FMA BMI2": those instruction sets that results may depend on.
std::string instructionText(std::uint64_t instructions);

}  // namespace trex::machines
