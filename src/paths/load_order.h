// In which order pages come that rays wait for.
#pragma once

#include <cstdint>

namespace trex {

/// None of them changes a picture.
enum class LoadOrder : std::uint8_t {
  kPlan,     ///< planned, by rays that wait and by those that are expected
  kWaiting,  ///< planned, by rays that wait alone
  kInTurn    ///< a rival to compare with: blocks of pages go round
};

}  // namespace trex
