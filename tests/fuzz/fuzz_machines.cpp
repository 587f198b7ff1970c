// Any bytes as a message of another machine: what is accepted says the same again when it is
// written. The input is what samples hold (u8), how many (u8), the message. The mutator repairs the
// head, else nothing would get past it.
#include <cmath>
#include <cstring>
#include <vector>

#include "src/machines/messages.h"
#include "src/machines/sample_bytes.h"
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
  require(packSamples(samples, contents) == result.samples);
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
    case Kind::kPong:
    case Kind::kBye:
    case Kind::kRest:
    case Kind::kPing:
    case Kind::kStop:
      break;
  }
}

}  // namespace

int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < kBefore) return 0;
  try {
    read(std::as_bytes(std::span(data, size)).subspan(kBefore), data[0] & 63u, data[1]);
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
  kind = static_cast<std::uint16_t>(1 + kind % static_cast<unsigned>(Kind::kStop));
  Bytes message(size - kBefore);
  std::memcpy(message.data(), data + kBefore, message.size());
  writeHead(static_cast<Kind>(kind), message);
  std::memcpy(data + kBefore, message.data(), message.size());
  return size;
}
