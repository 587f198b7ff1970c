// Who a machine is: what must be the same everywhere for pictures to have the same bits.
#pragma once

#include <string>

#include "src/machines/messages.h"

namespace trex::machines {

/// Of this process. `threads`: that it traces with.
Hello helloOfThis(std::uint32_t threads);

/// What another machine's greeting says that makes it unfit: another version or build. Empty if
/// nothing.
std::string whyUnfit(const Hello& mine, const Hello& other);

/// "AVX2 FMA BMI2": those instruction sets that results may depend on.
std::string instructionText(std::uint64_t instructions);

}  // namespace trex::machines
