#include "src/machines/sample_bytes.h"

#include <zstd.h>

#include <memory>
#include <utility>

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

constexpr std::byte kPlain{0}, kShort{1};
constexpr int kLevel = 1;  // of zstd

/// Which samples are paired, by the bits at the start of all. Throws MessageError if there are not
/// exactly `count` samples.
std::vector<std::uint8_t> pairsOf(ByteView plain, std::uint32_t contents, std::size_t count) {
  const std::size_t head = pairBytes(contents, count);
  const std::size_t alone = bytesOf(contents, false), paired = bytesOf(contents, true);
  if (plain.size() < head || (plain.size() - head) / alone < count)
    throw MessageError("it has fewer samples than its job");
  std::vector<std::uint8_t> is(count);
  std::size_t pairs = 0;
  for (std::size_t i = 0; i < 8 * head; ++i) {
    if ((plain[i / 8] >> (i % 8) & std::byte{1}) == std::byte{0}) continue;
    if (i >= count) throw MessageError("it marks samples that it has not");
    is[i] = 1;
    ++pairs;
  }
  if (plain.size() - head != (count - pairs) * alone + pairs * paired)
    throw MessageError("its samples have another size than its job's");
  return is;
}

/// Of the samples behind the pairs: calls `visit(size, starts)` for those that are not paired and
/// for those that are, with where they start as they lie.
template <class Visit>
void eachSet(std::span<const std::uint8_t> paired, std::uint32_t contents, const Visit& visit) {
  for (const bool set : {false, true}) {
    std::vector<std::size_t> starts;
    std::size_t at = 0;
    for (const std::uint8_t is : paired) {
      if ((is != 0) == set) starts.push_back(at);
      at += bytesOf(contents, is != 0);
    }
    visit(bytesOf(contents, set), starts);
  }
}

constexpr std::size_t kWord = sizeof(std::uint32_t);  // all parts are words

Bytes arranged(ByteView plain, std::size_t head, std::span<const std::uint8_t> paired,
               std::uint32_t contents) {
  Bytes out(plain.begin(), plain.end());
  const std::byte* from = plain.data() + head;
  std::byte* to = out.data() + head;
  eachSet(paired, contents, [&](std::size_t size, const std::vector<std::size_t>& starts) {
    const std::size_t count = starts.size();
    for (std::size_t at = 0; at < size && count > 0; at += kWord, to += kWord * count) {
      std::uint32_t before = 0, word;
      for (std::size_t i = 0; i < count; ++i) {
        std::memcpy(&word, from + starts[i] + at, kWord);
        const std::uint32_t change = word ^ std::exchange(before, word);
        for (std::size_t b = 0; b < kWord; ++b)
          to[b * count + i] = static_cast<std::byte>(change >> (8 * b) & 255u);
      }
    }
  });
  return out;
}

Bytes asTheyLay(ByteView arrangement, std::size_t head, std::span<const std::uint8_t> paired,
                std::uint32_t contents) {
  Bytes out(arrangement.begin(), arrangement.end());
  const std::byte* from = arrangement.data() + head;
  std::byte* to = out.data() + head;
  eachSet(paired, contents, [&](std::size_t size, const std::vector<std::size_t>& starts) {
    const std::size_t count = starts.size();
    for (std::size_t at = 0; at < size && count > 0; at += kWord, from += kWord * count) {
      std::uint32_t word = 0;
      for (std::size_t i = 0; i < count; ++i) {
        for (std::size_t b = 0; b < kWord; ++b)
          word ^= std::to_integer<std::uint32_t>(from[b * count + i]) << (8 * b);
        std::memcpy(to + starts[i] + at, &word, kWord);
      }
    }
  });
  return out;
}

// Contexts are costly to make: one a thread.
ZSTD_CCtx* compressor() {
  thread_local const std::unique_ptr<ZSTD_CCtx, std::size_t (*)(ZSTD_CCtx*)> context(
      ZSTD_createCCtx(), ZSTD_freeCCtx);
  if (!context) throw std::bad_alloc();
  return context.get();
}

/// kShort and a frame, or nothing if that is not shorter.
Bytes shortened(ByteView arrangement) {
  Bytes out(1 + ZSTD_compressBound(arrangement.size()));
  const std::size_t size = ZSTD_compressCCtx(compressor(), out.data() + 1, out.size() - 1,
                                             arrangement.data(), arrangement.size(), kLevel);
  if (ZSTD_isError(size) || size >= arrangement.size()) return {};
  out[0] = kShort;
  out.resize(1 + size);
  return out;
}

/// What a frame holds, `most` bytes at most.
Bytes lengthened(ByteView frame, std::uint64_t most) {
  const unsigned long long size = ZSTD_getFrameContentSize(frame.data(), frame.size());
  if (size > most) throw MessageError("its samples are more than its job's");  // or not said
  Bytes out(size);
  const std::size_t got = ZSTD_decompress(out.data(), out.size(), frame.data(), frame.size());
  if (ZSTD_isError(got) || got != out.size()) throw MessageError("its samples are damaged");
  return out;
}

}  // namespace

std::uint32_t contentsOf(const FrameBuffers& frame, bool pairs) {
  return (pairs ? kPairs : 0u) | (frame.features ? kFeatures : 0u) |
         (frame.coverage ? kCoverage : 0u) | (frame.firstHits ? kFirstHits : 0u) |
         (frame.direct ? kDirect : 0u) | (frame.dial ? kRays : 0u) |
         (frame.rayClasses ? kRayClasses : 0u) | (frame.photonNoise ? kPhotonNoise : 0u);
}

std::uint64_t mostBytesOf(std::uint32_t contents, std::uint64_t samples) {
  return 2 + samples / 8 + samples * bytesOf(contents, (contents & kPairs) != 0);
}

Bytes packSamples(std::span<const TakenSample> samples, std::uint32_t contents, bool isShort) {
  Bytes out(1 + pairBytes(contents, samples.size()));
  out.reserve(mostBytesOf(contents, samples.size()));
  out[0] = kPlain;
  std::vector<std::uint8_t> paired(samples.size());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    TakenSample s = samples[i];
    paired[i] = s.paired = s.paired && (contents & kPairs);
    if (s.paired) out[1 + i / 8] |= std::byte{1} << (i % 8);
    eachPart(s, contents, [&](const auto& part) {
      const auto* from = reinterpret_cast<const std::byte*>(&part);
      out.insert(out.end(), from, from + sizeof(part));
    });
  }
  if (!isShort || bytesOf(contents, false) == sizeof(TakenSample::guess)) return out;
  Bytes less = shortened(
      arranged(ByteView(out).subspan(1), pairBytes(contents, samples.size()), paired, contents));
  return less.empty() ? out : less;
}

std::vector<TakenSample> unpackSamples(ByteView bytes, std::uint32_t contents, std::size_t count) {
  if (bytes.empty() || bytes[0] > kShort) throw MessageError("its samples lie in an unknown way");
  ByteView plain = bytes.subspan(1);
  Bytes longer;
  if (bytes[0] == kShort) plain = longer = lengthened(plain, mostBytesOf(contents, count));
  const std::vector<std::uint8_t> paired = pairsOf(plain, contents, count);
  const std::size_t head = pairBytes(contents, count);
  if (bytes[0] == kShort) plain = longer = asTheyLay(plain, head, paired, contents);
  std::vector<TakenSample> out(count);
  const std::byte* at = plain.data() + head;
  for (std::size_t i = 0; i < count; ++i) {
    out[i].paired = paired[i] != 0;
    eachPart(out[i], contents, [&](auto& part) {
      std::memcpy(static_cast<void*>(&part), at, sizeof(part));
      at += sizeof(part);
    });
  }
  return out;
}

}  // namespace trex::machines
