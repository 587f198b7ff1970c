// What a window's machine and its servers say to each other, beside messages.h.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "src/machines/messages.h"

namespace trex::machines {

struct Serve {
  static constexpr Kind kKind = Kind::kServe;
  std::uint32_t width = 0, height = 0;  ///< that the model is opened for
  std::string arguments;                ///< of the window's command line, each ended by a zero
  template <class F>
  void fields(F&& f) {
    f(width), f(height), f(arguments);
  }
};

struct Edit {
  static constexpr Kind kKind = Kind::kEdit;
  std::uint32_t number = 0, width = 0, height = 0;
  std::string look;  ///< an overlay on the model: look_file.h
  template <class F>
  void fields(F&& f) {
    f(number), f(width), f(height), f(look);
  }
};

struct Aim {
  static constexpr Kind kKind = Kind::kAim;
  std::uint32_t light = 0;    ///< another number, another light
  std::uint64_t photons = 0;  ///< of it
  std::uint64_t leaves = 0;   ///< of its voxels
  std::string aim;            ///< where photons go: the "light" of an overlay
  std::uint8_t send = 0;  ///< the window wants those that are shot: kShot, whose view is `light`
  template <class F>
  void fields(F&& f) {
    f(light), f(photons), f(leaves), f(aim), f(send);
  }
};

struct Lit {
  static constexpr Kind kKind = Kind::kLit;
  std::uint32_t light = 0;
  std::uint64_t photons = 0;
  template <class F>
  void fields(F&& f) {
    f(light), f(photons);
  }
};

/// Cells [firstCell, endCell) of one sample of a tile.
struct LentUnit {
  std::uint32_t tile = 0, sample = 0, firstCell = 0, endCell = 0;
};

struct Lent {
  static constexpr Kind kKind = Kind::kLent;
  std::uint32_t edit = 0, id = 0, light = 0;
  std::uint64_t photons = 0;   ///< whose light the samples read; 0: none
  double coneShare = 0.0;      ///< Session::coneShare() of the window
  std::uint32_t contents = 0;  ///< of samples: sample_bytes.h
  std::vector<LentUnit> units{};
  std::vector<double> shares{};  ///< of exact samples, by unit; none without a dial
  template <class F>
  void fields(F&& f) {
    f(edit), f(id), f(light), f(photons), f(coneShare), f(contents), f(units), f(shares);
  }
};

/// Its light is another by now, or was to become another meanwhile.
struct NoLoan {
  static constexpr Kind kKind = Kind::kNoLoan;
  std::uint32_t id = 0;
  template <class F>
  void fields(F&& f) {
    f(id);
  }
};

}  // namespace trex::machines
