// Rows of the elements of PLY files: which of their properties are shown.
#pragma once

#include <algorithm>
#include <array>
#include <map>
#include <string>
#include <string_view>
#include <vector>

#include "src/core/error.h"
#include "src/scene/ply_file.h"
#include "src/scene/scene.h"

namespace trex::detail {

/// What a vertex property is stored as.
enum Slot { kX, kY, kZ, kNx, kNy, kNz, kU, kV, kRed, kGreen, kBlue, kAlpha, kSlots, kUnused };

inline Slot slotOf(const PlyProperty& property) {
  static const std::map<std::string_view, Slot> kNames = {{"x", kX},
                                                          {"y", kY},
                                                          {"z", kZ},
                                                          {"nx", kNx},
                                                          {"ny", kNy},
                                                          {"nz", kNz},
                                                          {"u", kU},
                                                          {"s", kU},
                                                          {"texture_u", kU},
                                                          {"v", kV},
                                                          {"t", kV},
                                                          {"texture_v", kV},
                                                          {"red", kRed},
                                                          {"green", kGreen},
                                                          {"blue", kBlue},
                                                          {"alpha", kAlpha},
                                                          {"diffuse_red", kRed},
                                                          {"diffuse_green", kGreen},
                                                          {"diffuse_blue", kBlue},
                                                          {"r", kRed},
                                                          {"g", kGreen},
                                                          {"b", kBlue},
                                                          {"a", kAlpha}};
  std::string name = property.name;  // some programs write capitals
  for (char& c : name) c = static_cast<char>(c >= 'A' && c <= 'Z' ? c - 'A' + 'a' : c);
  const auto found = property.isList ? kNames.end() : kNames.find(name);
  return found == kNames.end() ? kUnused : found->second;
}

/// What integers must be divided by to lie in [0, 1]. Those of 32 bits are bytes in a wide type.
inline double colorScale(PlyType type) {
  switch (type) {
    case PlyType::kInt8:
      return 127.0;
    case PlyType::kInt16:
      return 32767.0;
    case PlyType::kUint16:
      return 65535.0;
    case PlyType::kUint8:
    case PlyType::kInt32:
    case PlyType::kUint32:
      return 255.0;
    default:
      return 1.0;
  }
}

/// Where an element's row keeps what this program shows of it.
struct PlyRow {
  explicit PlyRow(const PlyElement& element) : properties(element.properties) {
    divisor.fill(1.0);
    for (const PlyProperty& p : properties) {
      const Slot slot = slotOf(p);
      slots.push_back(slot);
      if (slot == kUnused) continue;
      has[slot] = true;
      if (slot >= kRed) divisor[slot] = colorScale(p.type);
      if (slot == kRed) srgb = isInteger(p.type);
      wide = wide || (slot <= kZ && p.type == PlyType::kDouble);
    }
  }
  /// Reads the next row of the file, or skips what is not shown.
  void read(PlyFile& file) {
    for (std::size_t k = 0; k < slots.size(); ++k) {
      if (slots[k] == kUnused) {
        file.skip(properties[k]);
      } else {
        value[slots[k]] = file.scalar(properties[k].type);
      }
    }
  }
  bool normals() const { return has[kNx] && has[kNy] && has[kNz]; }
  bool texCoords() const { return has[kU] && has[kV]; }
  bool colors() const { return has[kRed] && has[kGreen] && has[kBlue]; }
  /// Of the values read last. Integers are sRGB, floats linear.
  glm::u8vec4 color() {
    vec4 c(1.0f);
    bool bright = false;
    for (int k = 0; k < 3; ++k) {
      const auto channel = static_cast<float>(value[kRed + k] / divisor[kRed + k]);
      bright = bright || channel > 1.0f;
      c[k] = srgb ? decodeSrgb(channel) : channel;
    }
    tooBright += bright;
    if (has[kAlpha]) c.a = static_cast<float>(value[kAlpha] / divisor[kAlpha]);
    return packVertexColor(c);
  }

  const std::vector<PlyProperty>& properties;
  std::vector<Slot> slots;  ///< by property
  std::array<bool, kSlots> has{};
  std::array<double, kSlots> value{}, divisor{};
  std::uint64_t tooBright = 0;  ///< of the colours, those that had to be clamped
  bool srgb = false, wide = false;
};

inline void tellBright(Scene& scene, const std::string& file, const PlyRow& row) {
  if (row.tooBright == 0) return;
  scene.replaced.add(
      fmt::format("{}: {} colours of floats are above 1, which is used; 255 is one "
                  "of integers",
                  file, row.tooBright));
}

/// Where a face's row keeps what is shown.
struct PlyFaceRow {
  explicit PlyFaceRow(const PlyElement& element) : row(element) {
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      const PlyProperty& p = element.properties[k];
      if (p.isList && (p.name == "vertex_indices" || p.name == "vertex_index")) indices = k;
      if (p.isList && p.name == "texcoord") texCoords = k;
      if (!p.isList && p.name == "texnumber") number = k;
    }
  }
  static constexpr std::size_t kAbsent = ~std::size_t{0};
  PlyRow row;
  std::size_t indices = kAbsent, texCoords = kAbsent, number = kAbsent;
};

}  // namespace trex::detail
