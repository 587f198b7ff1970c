#include "src/machines/sample_bytes.h"

namespace trex::machines {
namespace {

static_assert(sizeof(Feature) == 11 * 4 && sizeof(FirstHit) == 3 * 4 && sizeof(vec3) == 3 * 4,
              "their bytes travel as they lie");

/// Calls `visit` with each part of a sample that travels.
template <class Sample, class Visit>
void eachPart(Sample& s, std::uint32_t contents, Visit&& visit) {
  visit(s.guess);
  if (s.paired) visit(s.exact);
  if (contents & kFeatures) visit(s.light), visit(s.feature);
  if (contents & kCoverage) visit(s.alpha);
  if (contents & kFirstHits) visit(s.first);
  if (contents & kDirect) {
    visit(s.direct);
    if (s.paired) visit(s.directExact);
  }
  if (contents & kRays) visit(s.rays);
  if (contents & kRayClasses) visit(s.cRays), visit(s.gRays);
  if (contents & kPhotonNoise) visit(s.photonNoise);
}

std::size_t bytesOf(std::uint32_t contents, bool paired) {
  TakenSample s;
  s.paired = paired;
  std::size_t bytes = 0;
  eachPart(s, contents, [&](const auto& part) { bytes += sizeof(part); });
  return bytes;
}

std::size_t pairBytes(std::uint32_t contents, std::size_t count) {
  return contents & kPairs ? (count + 7) / 8 : 0;
}

}  // namespace

std::uint32_t contentsOf(const FrameBuffers& frame, bool pairs) {
  return (pairs ? kPairs : 0u) | (frame.features ? kFeatures : 0u) |
         (frame.coverage ? kCoverage : 0u) | (frame.firstHits ? kFirstHits : 0u) |
         (frame.direct ? kDirect : 0u) | (frame.dial ? kRays : 0u) |
         (frame.rayClasses ? kRayClasses : 0u) | (frame.photonNoise ? kPhotonNoise : 0u);
}

std::uint64_t mostBytesOf(std::uint32_t contents, std::uint64_t samples) {
  return samples / 8 + 1 + samples * bytesOf(contents, (contents & kPairs) != 0);
}

Bytes packSamples(std::span<const TakenSample> samples, std::uint32_t contents) {
  Bytes out(pairBytes(contents, samples.size()));
  out.reserve(mostBytesOf(contents, samples.size()));
  for (std::size_t i = 0; i < samples.size(); ++i) {
    TakenSample s = samples[i];
    s.paired = s.paired && (contents & kPairs);
    if (s.paired) out[i / 8] |= std::byte{1} << (i % 8);
    eachPart(s, contents, [&](const auto& part) {
      const auto* from = reinterpret_cast<const std::byte*>(&part);
      out.insert(out.end(), from, from + sizeof(part));
    });
  }
  return out;
}

std::vector<TakenSample> unpackSamples(ByteView bytes, std::uint32_t contents, std::size_t count) {
  const std::size_t head = pairBytes(contents, count);
  const std::size_t alone = bytesOf(contents, false), paired = bytesOf(contents, true);
  if (bytes.size() < head || (bytes.size() - head) / alone < count) {
    throw MessageError("it has fewer samples than its job");
  }
  std::size_t pairs = 0;
  const auto isPaired = [&](std::size_t i) {
    return head > 0 && (bytes[i / 8] >> (i % 8) & std::byte{1}) != std::byte{0};
  };
  for (std::size_t i = 0; i < 8 * head; ++i) {
    if (!isPaired(i)) continue;
    if (i >= count) throw MessageError("it marks samples that it has not");
    ++pairs;
  }
  if (bytes.size() - head != (count - pairs) * alone + pairs * paired) {
    throw MessageError("its samples have another size than its job's");
  }
  std::vector<TakenSample> out(count);
  const std::byte* at = bytes.data() + head;
  for (std::size_t i = 0; i < count; ++i) {
    out[i].paired = isPaired(i);
    eachPart(out[i], contents, [&](auto& part) {
      std::memcpy(static_cast<void*>(&part), at, sizeof(part));
      at += sizeof(part);
    });
  }
  return out;
}

}  // namespace trex::machines
