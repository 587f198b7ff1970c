// Which machine passes a page on to the others: plain data, no messages, no threads.
//
// Each page of machine 0's model has a HOME among those that can keep packed pages: others ask
// there, the home asks machine 0 once and keeps what comes. So a page leaves machine 0 once, and
// what is left to send is shared by all links. Homes are drawn by the page's place and the weights
// of the machines, each by itself (weighted rendezvous hashing: Thaler and Ravishankar 1998, and
// Schindelhauer and Schomaker 2005 for weights): if one is lost its pages move, those of others
// stay.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "src/machines/link_probe.h"

namespace trex::machines {

struct PageHome {
  std::uint32_t machine = 0;
  std::uint32_t weight = 1;  ///< of the pages it has, kWholeWeight at most
  bool operator==(const PageHome&) const = default;
};
inline constexpr std::uint32_t kWholeWeight = 256;

/// The home of what lies at an offset of the model's file; 0, which has all, if there are no homes.
std::uint32_t homeOf(std::uint64_t offset, std::span<const PageHome> homes);

/// A machine that could be a home, and its link.
struct HomeCandidate {
  std::uint32_t machine = 0;
  LinkSpeed link;
};
/// Those that are, by how fast links are: one that has less than a quarter of the speed that half
/// of them have has fewer pages, one that has less than a tenth none. None at all where there is
/// nobody to pass pages on to.
std::vector<PageHome> chooseHomes(std::span<const HomeCandidate> machines);

}  // namespace trex::machines
