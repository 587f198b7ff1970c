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
  /// Whether a message is there; receive() begins to take it, and `to` stays where it is until
  /// received() says done of `request`. (Who waits for a slow link within MPI keeps a core busy.)
  /// `whole`: false if its sender has died.
  const char* (*look)(bool& found, int& from, std::uint64_t& size);
  const char* (*receive)(void* to, void*& request);
  const char* (*received)(void* request, bool& done, bool& whole);
  /// Another process that has died since the job began, each once; -1: none. Only where the others
  /// outlive it (survives()); messages to it go nowhere.
  int (*lost)();
  /// Whether the job goes on without a process that dies: Open MPI 5 with --with-ft ulfm.
  bool (*survives)();
  /// Waits for all others that live. `unclean`: some did not, so that MPI can't be ended as it
  /// should, and the process had better end at once.
  const char* (*finish)(bool& unclean);
  /// Ends all processes of the job, with this code; does not return.
  void (*abort)(int code);
};

extern "C" const MpiFunctions* trexMpiFunctions();
inline constexpr const char* kTrexMpiFunctions = "trexMpiFunctions";

}  // namespace trex
