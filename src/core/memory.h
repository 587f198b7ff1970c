// What the process and the machine have of memory.
#pragma once

#include <cstdint>
#include <string>

namespace trex {

/// Largest resident size of this process so far, bytes (getrusage).
std::uint64_t peakResidentBytes();

/// Resident size of this process at the moment, bytes; 0 if unknown.
std::uint64_t residentBytes();

/// Memory this process may use: the smaller of physical memory and the cgroup's limit, bytes.
std::uint64_t availableMemoryLimit();

/// "1.5 MiB" for people.
std::string formatBytes(std::uint64_t bytes);

}  // namespace trex
