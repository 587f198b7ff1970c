// Messages as bytes. Every message is
//
//   head  24 bytes: magic u32 | kind u16 | protocol u16 | body's bytes u64 | XXH3-64 of the body
//   u64 body  the fields of its struct in their order: numbers little endian, as wide as in the
//   struct;
//         texts and lists by their length (u32) and their elements
//
// Trust: decoding takes anything. What is not as above throws MessageError, before memory is taken
// that the message does not hold itself. What fields mean (numbers of views, tiles, jobs) is
// checked by those who read them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <limits>
#include <span>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <vector>

namespace trex::machines {

inline constexpr std::uint32_t kMagic = 0x4d585254u;  // "TRXM"
inline constexpr std::uint16_t kProtocol = 6;
inline constexpr std::size_t kHeadBytes = 24;
/// No message is longer; who receives one asks before it takes the memory.
inline constexpr std::uint64_t kMostBytes = std::uint64_t{1} << 28;

using Bytes = std::vector<std::byte>;
using ByteView = std::span<const std::byte>;

/// Bytes that are no message of this protocol.
class MessageError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

enum class Kind : std::uint16_t;  // messages.h

/// Writes the head of a message into its first kHeadBytes; the body follows them.
void writeHead(Kind kind, Bytes& message);
/// The kind of a message, whose body `body` becomes. Throws MessageError.
Kind openMessage(ByteView message, ByteView& body);

/// Elements of lists that are their bytes. (glm's vectors are, and do not say so.)
template <class T>
inline constexpr bool kIsBytes = std::is_trivially_copyable_v<T>;

/// Writes fields one after another.
class FieldWriter {
 public:
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(const T& value) { put(&value, sizeof(T)); }
  void operator()(const std::string& text) { list(text.data(), text.size(), 1); }
  void operator()(const ByteView& bytes) { list(bytes.data(), bytes.size(), 1); }
  template <class T>
  void operator()(const std::vector<T>& values) {
    static_assert(kIsBytes<T>);
    list(values.data(), values.size(), sizeof(T));
  }
  /// A list of so many bytes, to be filled before any other call.
  std::span<std::byte> list(std::size_t bytes) {
    if (bytes > std::numeric_limits<std::uint32_t>::max()) throw MessageError("a list is too long");
    (*this)(static_cast<std::uint32_t>(bytes));
    out_.resize(out_.size() + bytes);
    return std::span(out_).last(bytes);
  }
  /// The message whose body they are.
  Bytes take(Kind kind) {
    writeHead(kind, out_);
    return std::move(out_);
  }

 private:
  void put(const void* from, std::size_t size) {
    const std::size_t at = out_.size();
    out_.resize(at + size);
    std::memcpy(out_.data() + at, from, size);
  }
  void list(const void* from, std::size_t count, std::size_t size) {
    if (count > std::numeric_limits<std::uint32_t>::max()) throw MessageError("a list is too long");
    (*this)(static_cast<std::uint32_t>(count));
    if (count > 0) put(from, count * size);
  }
  Bytes out_ = Bytes(kHeadBytes);
};

/// Reads them. Throws MessageError.
class FieldReader {
 public:
  explicit FieldReader(ByteView body) : left_(body) {}
  template <class T>
  requires std::is_arithmetic_v<T>
  void operator()(T& value) { std::memcpy(&value, next(sizeof(T)).data(), sizeof(T)); }
  /// A list of bytes, as it lies in the body.
  void operator()(ByteView& bytes) { bytes = list(1); }
  void operator()(std::string& text) {
    const ByteView bytes = list(1);
    text.assign(reinterpret_cast<const char*>(bytes.data()), bytes.size());
  }
  template <class T>
  void operator()(std::vector<T>& values) {
    static_assert(kIsBytes<T>);
    const ByteView bytes = list(sizeof(T));
    values.resize(bytes.size() / sizeof(T));
    if (!bytes.empty()) {
      std::memcpy(static_cast<void*>(values.data()), bytes.data(), bytes.size());
    }
  }
  /// Nothing may be left.
  void end() const {
    if (!left_.empty()) throw MessageError("it is longer than what it holds");
  }

 private:
  ByteView next(std::uint64_t size) {
    if (size > left_.size()) throw MessageError("it is cut short");
    const ByteView found = left_.first(size);
    left_ = left_.subspan(size);
    return found;
  }
  ByteView list(std::size_t size) {
    std::uint32_t count = 0;
    (*this)(count);
    return next(std::uint64_t{count} * size);
  }
  ByteView left_;
};

template <class M>
Bytes encode(const M& message) {
  FieldWriter writer;
  const_cast<M&>(message).fields(writer);  // which changes nothing
  return writer.take(M::kKind);
}

/// Of the body of a message whose kind is M's. Throws MessageError.
template <class M>
M decode(ByteView body) {
  M message;
  FieldReader reader(body);
  message.fields(reader);
  reader.end();
  return message;
}

}  // namespace trex::machines
