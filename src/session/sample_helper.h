// Other machines that take samples for a window. The window's own machine traces the coarse frame,
// looks, previews and whatever else it has time for; of the rest of a frame others take whole
// samples of tiles. What does not come back is taken here: nobody is waited for.
#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace trex {

class Session;

/// Called by the session's thread alone, within its steps; each call returns in milliseconds.
class SampleHelper {
 public:
  virtual ~SampleHelper() = default;
  /// Other machines, and those of them that can take samples.
  virtual std::uint32_t machines() const = 0;
  virtual std::uint32_t readyMachines() const = 0;
  /// Whether some machine has the whole model for good: what the session leaves comes back.
  virtual bool takesAll() const = 0;
  /// The frame follows another look, as an overlay on the model (look_file.h), or has another size.
  virtual void edited(const std::string& overlay, std::uint32_t width, std::uint32_t height) = 0;
  /// Samples will read the light of so many photons, which are being shot.
  virtual void lightComes(const Session& session, std::uint64_t photons) = 0;
  /// Adds to the session's frame what has come for it, as long as keepGoing lets it, and lends
  /// tiles.
  virtual void exchange(Session& session, const std::function<bool()>& keepGoing) = 0;
  /// There is nothing left to take here: waits a little for what is lent, and exchanges. False if
  /// nothing is.
  virtual bool await(Session& session, const std::function<bool()>& keepGoing) = 0;
};

}  // namespace trex
