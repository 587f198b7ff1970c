// Access to a valid buffer.
#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>

#include "hccmesh/hccmesh.h"
#include "hccmesh/layout.h"
#include "hccmesh/leaf.h"
#include "hccmesh/octahedral.h"
#include "hccmesh/trace.h"
#include "hccmesh/validate.h"

namespace hccm {
namespace {

const layout::Header& headerOf(std::span<const std::byte> bytes) {
  return *reinterpret_cast<const layout::Header*>(bytes.data());
}
const layout::ClusterHeader& clusterOf(const std::byte* blob) {
  return *reinterpret_cast<const layout::ClusterHeader*>(blob);
}
// 2^stepExponent; the format's limits keep it a normal float.
float stepOf(std::span<const std::byte> bytes) {
  return std::bit_cast<float>((headerOf(bytes).stepExponent + 127) << 23);
}
GridBox boxOf(const layout::ClusterHeader& h) {
  GridBox box;
  for (int k = 0; k < 3; ++k) {
    box.lower[k] = h.lower[k];
    box.upper[k] = h.lower[k] + (std::int32_t(h.top[k]) << h.boxShift[k]);
  }
  return box;
}
template <typename T>
T readAs(const std::byte* at) {
  T value;
  std::memcpy(static_cast<void*>(&value), at, sizeof(T));
  return value;
}

glm::vec2 readTexCoord(const std::byte* at, bool floats, std::uint32_t vertex) {
  if (floats) return readAs<glm::vec2>(at + 8u * vertex);
  const auto least = readAs<glm::vec2>(at), scale = readAs<glm::vec2>(at + 8);
  return least + scale * glm::vec2(readAs<glm::u16vec2>(at + 16u + 4u * vertex));
}

// Apart: few meshes have them.
[[gnu::noinline]] void readSecondTexCoords(const std::byte* at, const layout::ClusterHeader& h,
                                           const std::uint32_t (&corners)[3], Triangle& out) {
  out.hasSecondTexCoords = true;
  for (int k = 0; k < 3; ++k)
    out.secondTexCoord[k] =
        readTexCoord(at, (h.flags & layout::kFloatSecondTexCoords) != 0, corners[k]);
}

}  // namespace

std::uint64_t Sizes::total() const {
  return header + clusterTable + clusterHeaders + vertices + topology + nodes + normals +
         texCoords + colors + padding;
}

Sizes& Sizes::operator+=(const Sizes& o) {
  header += o.header, clusterTable += o.clusterTable, clusterHeaders += o.clusterHeaders;
  vertices += o.vertices, topology += o.topology, nodes += o.nodes;
  normals += o.normals, texCoords += o.texCoords, colors += o.colors, padding += o.padding;
  return *this;
}

Mesh::Mesh(Bytes bytes) {
  auto owner = std::make_shared<const Bytes>(std::move(bytes));
  const std::span<const std::byte> view = *owner;
  *this = Mesh(view, std::move(owner));
}

Mesh::Mesh(std::span<const std::byte> bytes, std::shared_ptr<const void> owner)
    : bytes_(bytes),
      owner_(std::move(owner)),
      table_(reinterpret_cast<const std::uint32_t*>(bytes_.data() + sizeof(layout::Header))),
      step_(stepOf(bytes_)),
      cells_(1.0f / step_),
      kernels_(chooseKernels()) {
  std::vector<GridBox> boxes(clusterCount());
  for (std::uint32_t i = 0; i < clusterCount(); ++i) boxes[i] = boxOf(clusterOf(blob(i)));
  top_ = TopLevel(boxes);
}

Mesh::Mesh(std::span<const std::byte> bytes, std::shared_ptr<const void> owner, const Mesh& grid)
    : bytes_(bytes),
      owner_(std::move(owner)),
      table_(reinterpret_cast<const std::uint32_t*>(bytes_.data() + sizeof(layout::Header))),
      step_(grid.step_),
      cells_(grid.cells_),
      kernels_(grid.kernels_) {}

Mesh Mesh::fromBytes(const std::vector<std::byte>& bytes) {
  validate(bytes);
  Bytes own(bytes.size());
  std::memcpy(own.data(), bytes.data(), bytes.size());
  return Mesh(std::move(own));
}

Mesh Mesh::fromView(std::span<const std::byte> bytes, std::shared_ptr<const void> owner) {
  if (reinterpret_cast<std::uintptr_t>(bytes.data()) % alignof(layout::Header) != 0)
    throw FormatError("the buffer does not start at a multiple of 8");
  validate(bytes);
  return Mesh(bytes, std::move(owner));
}

std::uint64_t Mesh::triangleCount() const { return headerOf(bytes_).triangleCount; }
std::uint64_t Mesh::droppedTriangles() const { return headerOf(bytes_).droppedTriangles; }
std::uint32_t Mesh::clusterCount() const { return headerOf(bytes_).clusterCount; }
double Mesh::step() const { return double(stepOf(bytes_)); }
double Mesh::errorBound() const { return headerOf(bytes_).errorBound; }
glm::dvec3 Mesh::gridOrigin() const {
  const double* o = headerOf(bytes_).gridOrigin;
  return {o[0], o[1], o[2]};
}

Sizes Mesh::sizes() const {
  Sizes s;
  s.header = sizeof(layout::Header) + layout::kTailBytes;
  s.clusterTable = layout::firstBlob(clusterCount()) - sizeof(layout::Header);
  for (std::uint32_t i = 0; i < clusterCount(); ++i) {
    const layout::Offsets o = layout::offsetsOf(clusterOf(blob(i)));
    s.clusterHeaders += o.boxes;
    s.nodes += o.groupStarts - o.boxes;
    s.topology += o.vertices - o.groupStarts;
    s.vertices += o.normals - o.vertices;
    s.normals += o.texCoords - o.normals;
    s.texCoords += o.colors - o.texCoords + (o.attributesEnd - o.secondTexCoords);
    s.colors += o.secondTexCoords - o.colors;
    s.padding += o.end - o.attributesEnd;
  }
  return s;
}

void Mesh::clusterBounds(std::uint32_t cluster, glm::vec3& lower, glm::vec3& upper) const {
  const GridBox box = boxOf(clusterOf(blob(cluster)));
  const float step = stepOf(bytes_);
  for (int k = 0; k < 3; ++k) {
    lower[k] = static_cast<float>(box.lower[k] - 2) * step;
    upper[k] = static_cast<float>(box.upper[k] + 2) * step;
  }
}

void Mesh::bounds(glm::vec3& lower, glm::vec3& upper) const {
  const layout::Header& h = headerOf(bytes_);
  const float step = stepOf(bytes_);
  for (int k = 0; k < 3; ++k) {
    lower[k] = static_cast<float>(h.lower[k]) * step;
    upper[k] = static_cast<float>(h.upper[k]) * step;
  }
}

std::uint32_t Mesh::clusterTriangleCount(std::uint32_t cluster) const {
  return clusterOf(blob(cluster)).triangles();
}
std::uint32_t Mesh::clusterLeafCount(std::uint32_t cluster) const {
  return clusterOf(blob(cluster)).leafCount;
}
std::uint32_t Mesh::leafTriangleCount(std::uint32_t cluster, std::uint32_t leaf) const {
  const std::byte* b = blob(cluster);
  return readLeaf(b + layout::recordOffset(b, clusterOf(b), leaf)).triangles;
}
std::uint32_t Mesh::clusterMaterial(std::uint32_t cluster) const {
  return clusterOf(blob(cluster)).material;
}
std::uint32_t Mesh::clusterObject(std::uint32_t cluster) const {
  return clusterOf(blob(cluster)).object;
}

std::span<const std::byte> Mesh::clusterBytes(std::uint32_t cluster) const {
  const std::byte* b = blob(cluster);
  return {b, layout::offsetsOf(clusterOf(b)).end};
}

Triangle Mesh::triangle(std::uint32_t cluster, std::uint32_t index) const {
  const std::byte* b = blob(cluster);
  const layout::ClusterHeader& h = clusterOf(b);
  const layout::Offsets o = layout::offsetsOf(h);
  const float step = stepOf(bytes_);
  Triangle out{};
  out.material = h.material;
  out.object = h.object;
  out.hasNormals = (h.flags & layout::kNormals) != 0;
  out.hasTexCoords = (h.flags & layout::kTexCoords) != 0;
  out.hasColors = (h.flags & layout::kColors) != 0;
  const std::uint32_t place = index % layout::kLeafSize;
  std::uint32_t corners[3];
  if (expanded_) {
    const ExpandedLeaf& leaf = expanded_->leaf(cluster, index / layout::kLeafSize);
    for (int corner = 0; corner < 3; ++corner) {
      corners[corner] = leaf.vertex[corner][place];
      for (int k = 0; k < 3; ++k) out.position[corner][k] = leaf.corner[corner][k][place] * step;
    }
  } else {
    kernels_->corners(b + layout::recordOffset(b, h, index / layout::kLeafSize), place, corners);
    for (int corner = 0; corner < 3; ++corner) {
      std::int32_t grid[3];
      layout::readVertex(b + o.vertices, h, corners[corner], grid);
      for (int k = 0; k < 3; ++k) out.position[corner][k] = static_cast<float>(grid[k]) * step;
    }
  }
  for (std::uint32_t corner = 0; corner < 3; ++corner) {
    const std::uint32_t vertex = corners[corner];
    if (out.hasNormals)
      out.normal[corner] = decodeOctahedral(readAs<std::uint32_t>(b + o.normals + 4u * vertex));
    if (out.hasTexCoords)
      out.texCoord[corner] =
          readTexCoord(b + o.texCoords, (h.flags & layout::kFloatTexCoords) != 0, vertex);
    out.color[corner] = glm::vec4(1.0f);
    if (out.hasColors)
      out.color[corner] =
          glm::vec4(readAs<glm::u8vec4>(b + o.colors + 4u * vertex)) * (1.0f / 255.0f);
  }
  if (h.flags & layout::kSecondTexCoords) [[unlikely]]
    readSecondTexCoords(b + o.secondTexCoords, h, corners, out);
  return out;
}

MeshView Mesh::view() const { return {top_.nodes().data(), bytes_.data(), table_}; }

void Mesh::expand() {
  if (expanded_ || clusterCount() == 0) return;
  expanded_ = std::make_shared<const Expanded>(*this);
  expandedKernels_ = chooseExpandedKernels();
}

const char* Mesh::targetName() const { return kernels_->name; }

bool Mesh::intersect(std::uint32_t cluster, PreparedRay& ray, Hit& hit) const {
  return kernels_->intersect(blob(cluster), ray, cluster, hit);
}
bool Mesh::occluded(std::uint32_t cluster, const PreparedRay& ray) const {
  return kernels_->occluded(blob(cluster), ray, cluster);
}
bool Mesh::intersect(PreparedRay& ray, Hit& hit) const {
  if (expanded_) return expandedKernels_->intersect(view(), *expanded_, ray, hit);
  return !top_.nodes().empty() && kernels_->intersectMesh(view(), ray, hit);
}
bool Mesh::occluded(const PreparedRay& ray) const {
  if (expanded_) return expandedKernels_->occluded(view(), *expanded_, ray);
  return !top_.nodes().empty() && kernels_->occludedMesh(view(), ray);
}
void Mesh::intersect(std::span<PreparedRay> rays, std::span<Hit> hits) const {
  if (expanded_)
    expandedKernels_->intersectSpan(view(), *expanded_, rays, hits.data());
  else if (!top_.nodes().empty())
    kernels_->intersectSpan(view(), rays, hits.data());
}
void Mesh::occluded(std::span<const PreparedRay> rays, std::span<std::uint8_t> blocked) const {
  if (expanded_)
    expandedKernels_->occludedSpan(view(), *expanded_, rays, blocked.data());
  else if (!top_.nodes().empty())
    kernels_->occludedSpan(view(), rays, blocked.data());
  else
    std::ranges::fill(blocked, std::uint8_t{0});
}

namespace {

constexpr float kFar = 0x1p26f, kNear = 0x1p25f;  // cells; the mesh ends at 2^23

// Moves a far origin forward along the ray.
void approach(const Ray& ray, PreparedRay& p) {
  p.shift = -glm::dot(p.exactOrigin, p.direction) / glm::dot(p.direction, p.direction) -
            double(kNear) / glm::length(p.direction);
  if (std::isfinite(p.shift))
    p.exactOrigin += p.shift * p.direction;
  else
    p.shift = 0.0;
  p.tnear = static_cast<float>(double(ray.tnear) * double(p.cells) - p.shift);
  Mesh::setFar(p, ray.tfar);
}

// Without branches: which axis it is can't be foreseen.
int longestAxis(const float (&size)[3]) {
  const bool xy = size[0] > size[1], xz = size[0] > size[2], yz = size[1] > size[2];
  return 2 - 2 * (xy & xz) - (!xy & yz);
}

// What of a surface's distance may be rounding of corners as seen from the ray: cells.
constexpr double kRounding = 0x1p-25, kLeastSlack = 0x1p-12;

void setSurfaces(const Ray& ray, PreparedRay& p) {
  p.fromCluster = ray.fromCluster;
  p.fromTriangle = ray.fromTriangle;
  p.toCluster = ray.toCluster;
  p.toTriangle = ray.toTriangle;
  p.slack = ray.slack >= 0.0 ? ray.slack * double(p.cells) + kRounding : -1.0;
  // What has a plane within the slack of the start, but is met further away than single precision
  // may be wrong, would have to be seen more edge-on than that slack allows.
  p.sureFrom = p.slack > kLeastSlack ? std::numeric_limits<float>::infinity() : p.tnear;
  p.sureTo = p.tfar;
  p.targetSlack = -1.0;
  if (!ray.target) return;
  p.target = *ray.target * double(p.cells);
  p.targetSlack = ray.targetSlack * double(p.cells) + kRounding;
  p.sureTo = std::min(0.9f * p.tfar, p.tfar - 64.0f * static_cast<float>(p.targetSlack));
}

// Four lanes, written in one piece as the test of boxes reads them: it would wait for what was
// written number by number.
using Floats = float __attribute__((vector_size(16)));
using Ints = std::int32_t __attribute__((vector_size(16)));
template <typename Lanes, typename T>
void store(const Lanes& lanes, T (&to)[4]) {
  static_assert(sizeof(lanes) == sizeof(to));
  std::memcpy(to, &lanes, sizeof(lanes));
}

// A component this much smaller than the largest moves the ray by less than a cell. So no product
// of its inverse and a place overflows.
constexpr float kLeastComponent = 0x1p-40f;

void setDirection(const Ray& ray, PreparedRay& p) {
  const float d[3] = {ray.direction.x, ray.direction.y, ray.direction.z};
  const float size[3] = {std::abs(d[0]), std::abs(d[1]), std::abs(d[2])};
  const int kz = longestAxis(size);
  p.depth = size[kz];
  // With the direction's sign they keep the winding.
  static constexpr std::int8_t kAcross[2][3] = {{1, 2, 0}, {2, 0, 1}};
  const bool down = d[kz] < 0.0f;
  const int kx = kAcross[down][kz], ky = kAcross[!down][kz];
  p.axis[0] = kx, p.axis[1] = ky, p.axis[2] = kz;
  const Floats shear = Floats{d[kx], d[ky], 1.0f, 0.0f} / d[kz];
  for (int k = 0; k < 3; ++k) p.shear[k] = shear[k];
  const float least = p.depth * kLeastComponent;
  const Floats away{d[0], d[1], d[2], 1.0f}, sizes{size[0], size[1], size[2], 1.0f};
  const Ints sign = std::bit_cast<Ints>(away) & std::numeric_limits<std::int32_t>::min();
  const Floats leasts{least, least, least, least};
  const Floats far = std::bit_cast<Floats>(std::bit_cast<Ints>(leasts) | sign);
  const Floats inverse = 1.0f / (sizes >= leasts ? away : far);
  store(std::bit_cast<Floats>(std::bit_cast<Ints>(inverse) & Ints{-1, -1, -1, 0}), p.inverse);
  store(Ints{0, 2, 4, 6} - (inverse < 0.0f), p.nearPlane);
}

void setOrigin(const glm::dvec3& whole, PreparedRay& p) {
  const glm::dvec3 rest = p.exactOrigin - whole;
  store(Ints{static_cast<std::int32_t>(whole.x), static_cast<std::int32_t>(whole.y),
             static_cast<std::int32_t>(whole.z), 0},
        p.cell);
  store(Floats{static_cast<float>(rest.x), static_cast<float>(rest.y), static_cast<float>(rest.z),
               0.0f},
        p.origin);
}

}  // namespace

PreparedRay Mesh::prepare(const Ray& ray) const {
  PreparedRay p;
  p.step = step_;
  p.cells = cells_;
  setDirection(ray, p);
  p.shift = 0.0;
  p.direction = ray.direction;
  p.exactOrigin = ray.origin * double(p.cells);  // exact: a power of two
  const glm::dvec3 away = glm::abs(p.exactOrigin);
  if (away.x <= double(kFar) && away.y <= double(kFar) && away.z <= double(kFar)) [[likely]] {
    p.tnear = ray.tnear * p.cells;
    p.tfar = ray.tfar * p.cells;
    setOrigin({std::rint(p.exactOrigin.x), std::rint(p.exactOrigin.y), std::rint(p.exactOrigin.z)},
              p);
    p.isFar = std::max({away.x, away.y, away.z}) > 0x1p24 + 0.5;
  } else {
    approach(ray, p);
    p.isFar = false;
    glm::dvec3 whole(0.0);
    for (int k = 0; k < 3; ++k) {
      if (std::abs(p.exactOrigin[k]) < 0x1p30) whole[k] = std::rint(p.exactOrigin[k]);
      p.isFar |= std::abs(whole[k]) > 0x1p24;
    }
    setOrigin(whole, p);
  }
  setSurfaces(ray, p);
  const glm::vec3 size = glm::abs(ray.direction);
  if (!(p.depth >= 0x1p-60f) || !std::isfinite(size.x + size.y + size.z)) {
    p.tnear = std::numeric_limits<float>::infinity();  // an empty interval
    p.tfar = -p.tnear;
    for (int k = 0; k < 3; ++k) p.shear[k] = p.inverse[k] = 1.0f, p.nearPlane[k] = 2u * unsigned(k);
  }
  return p;
}

}  // namespace hccm
