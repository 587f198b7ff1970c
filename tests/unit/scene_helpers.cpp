#include "tests/unit/scene_helpers.h"

namespace trex::test {
namespace {

std::uint32_t crc(const std::string& bytes) {
  std::uint32_t c = 0xffffffffu;
  for (const unsigned char b : bytes) {
    c ^= b;
    for (int k = 0; k < 8; ++k) c = (c >> 1) ^ (c & 1 ? 0xedb88320u : 0u);
  }
  return ~c;
}

std::string big32(std::uint32_t v) { return {char(v >> 24), char(v >> 16), char(v >> 8), char(v)}; }

std::string chunk(const std::string& kind, const std::string& body) {
  return big32(static_cast<std::uint32_t>(body.size())) + kind + body + big32(crc(kind + body));
}

}  // namespace

std::string tinyPng() {
  const std::string rows("\0\xff\0\0\0\xff\0\0\0\0\xff\xff\xff\xff", 14);
  std::uint32_t a = 1, b = 0;
  for (const unsigned char c : rows) {
    a = (a + c) % 65521;
    b = (b + a) % 65521;
  }
  const std::string stored =
      std::string("\x78\x01\x01\x0e\x00\xf1\xff", 7) + rows + big32(b << 16 | a);
  const std::string header = big32(2) + big32(2) + std::string("\x08\x02\0\0\0", 5);
  return "\x89PNG\r\n\x1a\n" + chunk("IHDR", header) + chunk("IDAT", stored) + chunk("IEND", "");
}

std::string base64(const std::string& bytes) {
  const char* digits = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    std::uint32_t v = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      v = v << 8 | (i + k < bytes.size() ? static_cast<unsigned char>(bytes[i + k]) : 0u);
    }
    for (int k = 0; k < 4; ++k) {
      out += i + k > bytes.size() ? '=' : digits[v >> (18 - 6 * k) & 63];
    }
  }
  return out;
}

}  // namespace trex::test
