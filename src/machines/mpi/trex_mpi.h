// The calls into libtrex_mpi.so, which alone links MPI: the program opens it when it was started as
// one of several. Both sides are built together.
#pragma once

#include <cstdint>

namespace trex {

/// All calls by one thread. Texts are what MPI says of an error, null where there is none, and stay
/// until the next call.
struct MpiFunctions {
  const char* library;  ///< "Open MPI v4.1.4"
  const char* (*start)(int& rank, int& size);
  /// `bytes` stay where they are until sent() says so of `request`.
  const char* (*send)(int to, const void* bytes, std::uint64_t size, void*& request);
  const char* (*sent)(void* request, bool& done);
  /// Whether a message is there; receive() takes it.
  const char* (*look)(bool& found, int& from, std::uint64_t& size);
  const char* (*receive)(void* to);
  /// Waits for all others.
  const char* (*finish)();
  /// Ends all processes of the job, with this code; does not return.
  void (*abort)(int code);
};

extern "C" const MpiFunctions* trexMpiFunctions();
inline constexpr const char* kTrexMpiFunctions = "trexMpiFunctions";

}  // namespace trex
