// Any bytes as a message of another machine: what is accepted says the same again when it is
// written. The input is what samples hold (u8), how many (u8), the message. The mutator repairs the
// head, else nothing would get past it.
#include <algorithm>
#include <cmath>
#include <cstring>
#include <vector>

#include "src/machines/messages.h"
#include "src/machines/photon_parts.h"
#include "src/machines/sample_bytes.h"
#include "src/machines/server.h"
#include "tests/fuzz/fuzz.h"

namespace {

using namespace trex::machines;
using trex::fuzz::require;

constexpr std::size_t kBefore = 2;

template <class M>
M readAndWrite(ByteView message, ByteView body) {
  M read = decode<M>(body);
  const Bytes again = encode(read);
  require(again.size() == message.size() &&
          std::memcmp(again.data(), message.data(), message.size()) == 0);
  return read;
}

void readSamples(const Result& result, std::uint32_t contents, std::size_t count) {
  const auto samples = unpackSamples(result.samples, contents, count);
  require(samples.size() == count);
  // The same samples can be written in several ways, of which ours are two.
  const Bytes plain = packSamples(samples, contents, false);
  for (const bool isShort : {false, true}) {
    const auto again = unpackSamples(packSamples(samples, contents, isShort), contents, count);
    require(packSamples(again, contents, false) == plain);
  }
}

/// What passes the check is of the range, and joins a batch of it once.
template <class M>
void readPhotons(const M& some) {
  checkPhotons(some.photons, some.first, some.end);
  PhotonParts parts({.first = some.first, .end = some.end});
  if (some.first >= some.end) return;
  require(parts.add(some.first, some.end, some.photons) && parts.whole());
  require(!parts.add(some.first, some.end, some.photons));
  const trex::ShotPhotons all = parts.joined();
  require(all.records.size() == some.photons.records.size());
  require(all.turns == some.photons.turns);
  for (const trex::shaderio::PhotonRecord& r : all.records) {
    const std::uint64_t number = r.index & (trex::shaderio::kPhotonNumbers - 1);
    require(number >= some.first && number < some.end);
  }
}

/// Every page has a home, whatever is said of weights.
void readHomes(const Homes& homes) {
  for (const std::uint64_t offset : {std::uint64_t{0}, std::uint64_t{65536}, ~std::uint64_t{0}}) {
    const std::uint32_t home = homeOf(offset, homes.machines);
    require(homes.machines.empty()
                ? home == 0
                : std::any_of(homes.machines.begin(), homes.machines.end(),
                              [&](const PageHome& h) { return h.machine == home; }));
  }
}

void readArguments(const Serve& serve) {
  require(joinArguments(splitArguments(serve.arguments)) == serve.arguments);
}

void read(ByteView message, std::uint32_t contents, std::size_t count) {
  ByteView body;
  switch (openMessage(message, body)) {
    case Kind::kHello:
      readAndWrite<Hello>(message, body);
      break;
    case Kind::kReady:
      readAndWrite<Ready>(message, body);
      break;
    case Kind::kSet:
      readAndWrite<ViewSet>(message, body);
      break;
    case Kind::kResult:
      readSamples(readAndWrite<Result>(message, body), contents, count);
      break;
    case Kind::kFetch:
      readAndWrite<Fetch>(message, body);
      break;
    case Kind::kAtPhotons:
      readAndWrite<AtPhotons>(message, body);
      break;
    case Kind::kShot:
      readPhotons(readAndWrite<Shot>(message, body));
      break;
    case Kind::kShoot:
      readAndWrite<ShootPhotons>(message, body);
      break;
    case Kind::kPhotons:
      readPhotons(readAndWrite<Photons>(message, body));
      break;
    case Kind::kAlone:
      readAndWrite<ShootAlone>(message, body);
      break;
    case Kind::kFailed:
      readAndWrite<Failed>(message, body);
      break;
    case Kind::kWelcome:
      readAndWrite<Welcome>(message, body);
      break;
    case Kind::kView:
      readAndWrite<SetView>(message, body);
      break;
    case Kind::kLight:
      readAndWrite<LightComes>(message, body);
      break;
    case Kind::kPass:
      readAndWrite<Pass>(message, body);
      break;
    case Kind::kJob:
      readAndWrite<GiveJob>(message, body);
      break;
    case Kind::kPart:
      readAndWrite<Part>(message, body);
      break;
    case Kind::kNoPart:
      readAndWrite<NoPart>(message, body);
      break;
    case Kind::kLit:
      readAndWrite<Lit>(message, body);
      break;
    case Kind::kNoLoan:
      readAndWrite<NoLoan>(message, body);
      break;
    case Kind::kServe:
      readArguments(readAndWrite<Serve>(message, body));
      break;
    case Kind::kEdit:
      readAndWrite<Edit>(message, body);
      break;
    case Kind::kAim:
      readAndWrite<Aim>(message, body);
      break;
    case Kind::kLent:
      readAndWrite<Lent>(message, body);
      break;
    case Kind::kProbe:
      readAndWrite<Probe>(message, body);
      break;
    case Kind::kProbed:
      readAndWrite<Probed>(message, body);
      break;
    case Kind::kLink:
      readAndWrite<LinkFound>(message, body);
      break;
    case Kind::kHomes:
      readHomes(readAndWrite<Homes>(message, body));
      break;
    case Kind::kPong:
    case Kind::kBye:
    case Kind::kRest:
    case Kind::kPing:
    case Kind::kStop:
    case Kind::kEnd:
      break;
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < kBefore) return 0;
  try {
    read(std::as_bytes(std::span(data, size)).subspan(kBefore), data[0], data[1]);
  } catch (const MessageError&) {
    // Expected.
  }
  return 0;
}

extern "C" std::size_t LLVMFuzzerCustomMutator(std::uint8_t* data, std::size_t size,
                                               std::size_t most, unsigned seed) {
  size = LLVMFuzzerMutate(data, size, most);
  if (size < kBefore + kHeadBytes || seed % 16 == 0) return size;
  std::uint16_t kind = 0;
  std::memcpy(&kind, data + kBefore + 4, sizeof(kind));
  kind = static_cast<std::uint16_t>(1 + kind % static_cast<unsigned>(kLastKind));
  Bytes message(size - kBefore);
  std::memcpy(message.data(), data + kBefore, message.size());
  writeHead(static_cast<Kind>(kind), message);
  std::memcpy(data + kBefore, message.data(), message.size());
  return size;
}
