// What carries messages between machines. MPI is one (mpi_wire.h), a test's own another.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "src/machines/messages.h"

namespace trex::machines {

/// A message, and who sent it.
struct Received {
  std::uint32_t from = 0;
  Bytes message;
};

/// Machines 0 to size() - 1. Messages of one machine to another come in the order they were sent
/// in. One thread, the one that made it, for all calls.
class Wire {
 public:
  virtual ~Wire() = default;
  virtual std::uint32_t rank() const = 0;
  virtual std::uint32_t size() const = 0;
  /// Takes a message and returns at once. Throws Error(kFailed).
  virtual void send(std::uint32_t to, Bytes message) = 0;
  /// A message that is there, or nothing. Throws Error(kFailed), for one of more than kMostBytes
  /// too.
  virtual std::optional<Received> receive() = 0;
  /// Messages that are on their way to this machine or, taken by send(), from it. Moves them on.
  virtual std::size_t unsent() = 0;
  /// A machine that has died, while the others go on; each once.
  virtual std::optional<std::uint32_t> lost() { return {}; }
  /// The end, which all machines come to that live: waits for them.
  virtual void finish() = 0;
  /// Ends all machines at once, those that don't answer too, as if this one had ended with `code`.
  virtual void abort(int code) = 0;
};

}  // namespace trex::machines
