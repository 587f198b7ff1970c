#include <algorithm>
#include <cmath>

#include "src/scene/import_detail.h"
#include "src/scene/ply_layout.h"
#include "src/scene/ply_rows.h"

namespace trex::detail {
namespace {

PlyLayout layoutOf(const PlyRow& row) {
  PlyLayout out;
  out.wide = true;
  out.countBytes = sizeof(std::uint32_t);
  out.normals = row.normals();
  out.colors = out.alpha = row.colors();
  out.stride = sizeof(dvec3);
  for (std::size_t k = 0; k < 3; ++k) out.place[k] = k * sizeof(double);
  for (std::size_t k = 0; out.normals && k < 3; ++k, out.stride += sizeof(float)) {
    out.normal[k] = out.stride;
  }
  for (std::size_t k = 0; out.colors && k < 4; ++k) out.color[k] = out.stride++;
  return out;
}

/// Whether vertices and faces are all there is, and all that is shown of them fits a layout.
bool fits(const PlyFile& file) {
  const auto& elements = file.elements();
  if (elements.size() != 2 || elements[0].name != "vertex" || elements[1].name != "face" ||
      elements[0].count == 0) {
    return false;
  }
  const PlyRow row(elements[0]);
  const PlyFaceRow face(elements[1]);
  return row.has[kX] && row.has[kY] && row.has[kZ] && !row.texCoords() && !face.row.colors() &&
         face.indices != PlyFaceRow::kAbsent && face.texCoords == PlyFaceRow::kAbsent &&
         isInteger(elements[1].properties[face.indices].type);
}

/// Whether vertices come first and nothing makes triangles of them.
bool isCloud(const PlyFile& file) {
  const auto& elements = file.elements();
  if (elements.empty() || elements[0].name != "vertex" || elements[0].count == 0) return false;
  const PlyRow row(elements[0]);
  return row.has[kX] && row.has[kY] && row.has[kZ] &&
         std::none_of(elements.begin() + 1, elements.end(), [](const PlyElement& e) {
           return e.count > 0 && (e.name == "face" || e.name == "tristrips");
         });
}

template <typename T>
void append(GrowingArray<std::uint8_t>& out, const T& value) {
  out.append(reinterpret_cast<const std::uint8_t*>(&value), sizeof(value));
}

void convertVertices(PlyFile& file, PlyRow& row, const PlyLayout& layout, std::uint64_t count,
                     GrowingArray<std::uint8_t>& out) {
  const auto& value = row.value;
  for (std::uint64_t i = 0; i < count; ++i) {
    row.read(file);
    append(out, dvec3(value[kX], value[kY], value[kZ]));
    if (layout.normals) append(out, vec3(value[kNx], value[kNy], value[kNz]));
    if (layout.colors) append(out, row.color());
  }
}

/// What is no number of a vertex becomes one that does not exist.
std::uint32_t indexOf(double value) {
  return value >= 0.0 && value < kMaxElements && value == std::floor(value)
             ? static_cast<std::uint32_t>(value)
             : 0xffffffffu;
}

void convertFaces(PlyFile& file, const PlyElement& element, GrowingArray<std::uint8_t>& out) {
  const PlyFaceRow face(element);
  for (std::uint64_t i = 0; i < element.count; ++i) {
    for (std::size_t k = 0; k < element.properties.size(); ++k) {
      const PlyProperty& property = element.properties[k];
      if (k != face.indices) {
        file.skip(property);
        continue;
      }
      const std::uint64_t corners = file.listCount(property);
      if (corners > kMaxElements) file.bad("a face has {} corners", corners);
      append(out, static_cast<std::uint32_t>(corners));
      for (std::uint64_t c = 0; c < corners; ++c) append(out, indexOf(file.scalar(property.type)));
    }
  }
}

}  // namespace

bool convertPly(const std::filesystem::path& path, bool clouds, Scene& scene, PlyLayout& layout,
                GrowingArray<std::uint8_t>& out) {
  PlyFile file(path);
  const bool cloud = clouds && isCloud(file);
  if (!cloud && !fits(file)) return false;
  const PlyElement& vertices = file.elements()[0];
  PlyRow row(vertices);
  layout = layoutOf(row);
  layout.vertices = vertices.count;
  layout.cloud = cloud;
  file.checkCount(vertices);
  convertVertices(file, row, layout, vertices.count, out);
  tellBright(scene, file.name(), row);
  for (std::size_t i = 1; cloud && i < file.elements().size(); ++i) {
    const PlyElement& other = file.elements()[i];
    if (other.count == 0) continue;
    scene.warnings.push_back(fmt::format("{}: element {} is left out", file.name(), other.name));
  }
  if (!cloud) {
    const PlyElement& faces = file.elements()[1];
    layout.faces = faces.count;
    file.checkCount(faces);
    convertFaces(file, faces, out);
  }
  if (file.badNumbers() > 0) {
    scene.replaced.add(fmt::format("{}: {} is not a number; not-a-number is used", file.name(),
                                   file.firstBadNumber()),
                       file.badNumbers());
  }
  return true;
}

}  // namespace trex::detail
