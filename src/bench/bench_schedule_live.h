// trex bench schedule --live: a streamed bundle rendered on this machine, with all pages in memory,
// with threads that wait for pages, and with paths that do.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <string>

namespace trex {

struct LiveArguments {
  std::string bundle;
  std::string size = "320x180";
  std::uint32_t samples = 8;
  std::uint32_t demandSamples = 1;  ///< of threads that wait: they take long; 0: no such row
  double exact = 1.0;               ///< below 1: with photons, too
  double cacheShare = 0.05;         ///< of the pages' bytes
  std::string rayMemory = "1G";
  bool cold = false;         ///< pages are read past the system's cache
  double diskRate = 0.0;     ///< MB/s of a disk that is played; 0: as it is. Cold, too
  double diskLatency = 0.1;  ///< ms of each of its requests
  std::string picture,
      trace;  ///< of the last way, which foresees: FILE.svg, FILE.json; may be empty
};

/// A row a way; seconds, seconds of all processors, loads and whether the picture has the bytes of
/// the first. Samples are traced without a device. Throws Error, kInput if the bundle has no pages.
nlohmann::ordered_json benchLive(const LiveArguments& arguments);
/// The rows as a table on stdout.
void printLive(const nlohmann::ordered_json& document);

}  // namespace trex
