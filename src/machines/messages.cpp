#include "src/machines/messages.h"

#define XXH_INLINE_ALL
#include <xxhash.h>

namespace trex::machines {
namespace {

struct Head {
  std::uint32_t magic = kMagic;
  std::uint16_t kind = 0, protocol = kProtocol;
  std::uint64_t bytes = 0, checksum = 0;
};
static_assert(sizeof(Head) == kHeadBytes && std::is_trivially_copyable_v<Head>);

}  // namespace

void writeHead(Kind kind, Bytes& message) {
  const ByteView body = ByteView(message).subspan(kHeadBytes);
  Head head;
  head.kind = static_cast<std::uint16_t>(kind);
  head.bytes = body.size();
  head.checksum = XXH3_64bits(body.data(), body.size());
  std::memcpy(message.data(), &head, kHeadBytes);
}

Kind openMessage(ByteView message, ByteView& body) {
  Head head;
  if (message.size() < kHeadBytes) throw MessageError("it is too short for a message");
  std::memcpy(&head, message.data(), kHeadBytes);
  if (head.magic != kMagic) throw MessageError("it is no message of trex");
  if (head.protocol != kProtocol) {
    throw MessageError("it is of protocol " + std::to_string(head.protocol) +
                       ", this trex speaks " + std::to_string(kProtocol) +
                       ": install the same build everywhere");
  }
  body = message.subspan(kHeadBytes);
  if (head.bytes != body.size()) throw MessageError("its length is wrong");
  if (head.checksum != XXH3_64bits(body.data(), body.size())) {
    throw MessageError("its checksum is wrong");
  }
  if (head.kind < static_cast<std::uint16_t>(Kind::kHello) ||
      head.kind > static_cast<std::uint16_t>(kLastKind)) {
    throw MessageError("it is of no kind that is known");
  }
  return static_cast<Kind>(head.kind);
}

}  // namespace trex::machines
