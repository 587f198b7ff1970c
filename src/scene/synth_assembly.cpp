// synth:assembly: a closed hall of different parts. Each part is a grid of quads wrapped around an
// axis (pipes, springs, tanks, plates, bolts), around a ring (gears), or laid out flat (floor,
// walls, ceiling, panels). How many parts there are and how fine they are both grow with the
// square root of the triangles.
#include <algorithm>
#include <array>
#include <cmath>

#include "src/core/error.h"
#include "src/scene/synth_detail.h"

namespace trex::detail {
namespace {

enum class Shape : std::uint8_t { kPipe, kSpring, kTank, kPlate, kBolt, kGear, kSheet };
constexpr std::array<const char*, 7> kShapeNames = {"pipe", "spring", "tank", "plate",
                                                    "bolt", "gear",   "sheet"};

/// Places in Scene::materials.
constexpr std::uint32_t kConcrete = 0, kFirstOfParts = 1, kOfParts = 6, kWhite = 6, kGlow = 7;

/// One part: u runs around (or across), v along. Lengths in metres.
struct Part {
  Shape shape = Shape::kPipe;
  std::uint32_t material = 0, object = 0;
  std::uint32_t around = 8, along = 4;  ///< quads
  bool caps = true;                     ///< the first and the last row are a point each
  vec3 centre{0.0f}, axis{0.0f, 0.0f, 1.0f}, side{1.0f, 0.0f, 0.0f};  ///< axes orthonormal
  float length = 1.0f, radius = 0.1f, second = 0.0f;  ///< second radius, or thickness
  float turns = 0.0f, phase = 0.0f;                   ///< teeth, coils, ribs
  std::uint64_t triangles() const { return 2ull * around * along - (caps ? 2ull * around : 0ull); }
};

constexpr float kTau = 2.0f * kPi;

/// A square wave with soft flanks, in [0, 1].
float tooth(float x) { return glm::smoothstep(-0.35f, 0.35f, std::sin(x)); }

/// Height of a dome of radius r in the middle of a unit square that repeats.
float dome(float x, float y, float r) {
  const float a = x - std::floor(x) - 0.5f, b = y - std::floor(y) - 0.5f;
  return std::sqrt(std::max(0.0f, r * r - a * a - b * b));
}

/// Makes rows of a part's vertices.
class PartMesher {
 public:
  explicit PartMesher(const Part& part)
      : p_(part), third_(glm::cross(part.axis, part.side)), turn_(part.around + 1) {
    for (std::uint32_t i = 0; i <= p_.around; ++i) {
      const float angle = kTau * static_cast<float>(i % p_.around) / static_cast<float>(p_.around);
      turn_[i] = vec2(std::cos(angle), std::sin(angle));
    }
  }
  void row(std::uint32_t j, std::vector<vec3>& out) const {
    out.resize(p_.around + 1);
    switch (p_.shape) {
      case Shape::kGear:
        return gearRow(j, out);
      case Shape::kSheet:
        return sheetRow(j, out);
      case Shape::kPlate:
        return plateRow(j, out);
      default:
        return tubeRow(j, out);
    }
  }

 private:
  /// Along the inner rows in [0, 1]; caps repeat the ends.
  float along(std::uint32_t j) const {
    if (!p_.caps) return static_cast<float>(j) / static_cast<float>(p_.along);
    const std::uint32_t last = p_.along - 2;
    const std::uint32_t inner = std::min(j == 0 ? 0u : j - 1u, last);
    return last == 0 ? 0.5f : static_cast<float>(inner) / static_cast<float>(last);
  }
  bool isCap(std::uint32_t j) const { return p_.caps && (j == 0 || j == p_.along); }

  vec3 world(const vec3& p) const {
    return p_.centre + p.x * p_.side + p.y * third_ + p.z * p_.axis;
  }

  /// Centre line at v, and the frame across it.
  void frame(float v, vec3& centre, vec3& n, vec3& b) const {
    const float z = (v - 0.5f) * p_.length;
    n = vec3(1.0f, 0.0f, 0.0f), b = vec3(0.0f, 1.0f, 0.0f), centre = vec3(0.0f, 0.0f, z);
    if (p_.shape == Shape::kSpring) {
      const float a = kTau * p_.turns * v, c = std::cos(a), s = std::sin(a);
      const vec3 along = glm::normalize(
          vec3(-s * p_.second * kTau * p_.turns, c * p_.second * kTau * p_.turns, p_.length));
      centre = vec3(p_.second * c, p_.second * s, z);
      n = vec3(c, s, 0.0f);
      b = glm::cross(along, n);
    } else if (p_.shape == Shape::kPipe) {  // with a swan neck
      const float slope = p_.second / p_.length * kTau * 0.5f * std::sin(kTau * v);
      const vec3 along = glm::normalize(vec3(slope, 0.0f, 1.0f));
      centre.x = p_.second * 0.25f * (1.0f - std::cos(kTau * v));
      n = glm::cross(b, along);
    }
  }

  float radiusAt(float v) const {
    switch (p_.shape) {
      case Shape::kPipe: {  // flanges
        const float x = v * p_.turns - std::floor(v * p_.turns);
        return p_.radius * (1.0f + 0.35f * glm::smoothstep(0.06f, 0.05f, std::min(x, 1.0f - x)));
      }
      case Shape::kTank: {  // round ends and ribs
        const float e = std::abs(2.0f * v - 1.0f), end = std::max(0.0f, (e - 0.6f) / 0.4f);
        return p_.radius *
               (std::sqrt(std::max(0.02f, 1.0f - end * end)) + 0.02f * tooth(kTau * p_.turns * v));
      }
      case Shape::kBolt:
        return v < 0.62f ? p_.radius * (0.55f + 0.02f * std::sin(kTau * p_.turns * v)) : p_.radius;
      default:
        return p_.radius;
    }
  }

  void tubeRow(std::uint32_t j, std::vector<vec3>& out) const {
    const float v = along(j);
    vec3 centre, n, b;
    frame(v, centre, n, b);
    const float r = isCap(j) ? 0.0f : radiusAt(v);
    const bool hexagon = p_.shape == Shape::kBolt && v >= 0.62f;
    const float rust = 0.004f * r * std::sin(37.0f * v + p_.phase);
    for (std::uint32_t i = 0; i <= p_.around; ++i) {
      float x = r + rust * turn_[i].x * turn_[i].y;
      if (hexagon)
        x /= std::max({std::abs(turn_[i].x), std::abs(0.5f * turn_[i].x + 0.866f * turn_[i].y),
                       std::abs(0.5f * turn_[i].x - 0.866f * turn_[i].y)});
      out[i] = world(centre + x * turn_[i].x * n + x * turn_[i].y * b);
    }
  }

  /// A slab: around its rectangle; rivets on top.
  void plateRow(std::uint32_t j, std::vector<vec3>& out) const {
    const float v = along(j), z = (v - 0.5f) * p_.length, flat = isCap(j) ? 0.0f : 1.0f;
    const std::uint32_t top = p_.around / 2 - 1;
    for (std::uint32_t i = 0; i <= p_.around; ++i) {
      const std::uint32_t at = i % p_.around;
      const bool above = at <= top;
      const float x =
          above ? static_cast<float>(at) / static_cast<float>(top)
                : 1.0f - static_cast<float>(at - top - 1) / static_cast<float>(p_.around - top - 2);
      const float across = (0.5f - x) * 2.0f * p_.radius;
      float height = above ? p_.second : -p_.second;
      const float pitch = 2.0f * p_.radius / p_.turns;
      if (above && flat > 0.0f) {
        height += pitch * dome(across / pitch + p_.phase, z / pitch, 0.27f);
      }
      out[i] = world(vec3(flat * across, flat * height, z));
    }
  }

  /// Around the axis in u; around the section in v.
  void gearRow(std::uint32_t j, std::vector<vec3>& out) const {
    const float v = static_cast<float>(j % p_.along) / static_cast<float>(p_.along);
    const vec2 place(std::cos(kTau * v), std::sin(kTau * v));
    // A rounded rectangle: pushed out to the square.
    const vec2 section =
        place /
        std::pow(std::pow(std::abs(place.x), 8.0f) + std::pow(std::abs(place.y), 8.0f), 0.125f);
    const float middle = 0.5f * (p_.radius + p_.second), half = 0.5f * (p_.radius - p_.second);
    for (std::uint32_t i = 0; i <= p_.around; ++i) {
      const float angle = static_cast<float>(i % p_.around) / static_cast<float>(p_.around);
      const float teeth = section.x > 0.0f ? section.x * tooth(kTau * p_.turns * angle) : 0.0f;
      const float r = middle + half * section.x + 0.14f * p_.radius * teeth;
      out[i] = world(vec3(r * turn_[i].x, r * turn_[i].y, 0.5f * p_.length * section.y));
    }
  }

  /// Flat: across in u, along in v; a pattern of studs.
  void sheetRow(std::uint32_t j, std::vector<vec3>& out) const {
    const float v = static_cast<float>(j) / static_cast<float>(p_.along);
    for (std::uint32_t i = 0; i <= p_.around; ++i) {
      const float u = static_cast<float>(i) / static_cast<float>(p_.around);
      const vec3 p((u - 0.5f) * p_.radius, 0.0f, (v - 0.5f) * p_.length);
      const float stud =
          p_.second > 0.0f ? p_.second * dome(p.x / p_.second, p.z / p_.second, 0.22f) : 0.0f;
      out[i] = world(vec3(p.x, stud, p.z));
    }
  }

  const Part& p_;
  vec3 third_;
  std::vector<vec2> turn_;
};

/// Numbers of one part, drawn in turn.
class Draw {
 public:
  explicit Draw(std::uint64_t key) : key_(mixBits(key)) {}
  float unit() { return uniform(key_ + 0x9e37u * ++count_); }
  float between(float low, float high) { return low + (high - low) * unit(); }
  float scaled(float low, float high) { return low * std::pow(high / low, unit()); }

 private:
  std::uint64_t key_, count_ = 0;
};

/// The hall and what stands in it.
class Layout {
 public:
  Layout(std::uint64_t triangles, std::uint64_t seed)
      : triangles_(static_cast<double>(triangles)), seed_(seed) {
    const double count = std::clamp(std::sqrt(triangles_), 6.0, 1e5);
    parts_ = static_cast<std::uint32_t>(count);
    cells_ = static_cast<std::uint32_t>(std::ceil(std::sqrt(parts_ / 2.0)));
    edge_ = static_cast<float>(std::max(4u, cells_));
    height_ = std::clamp(0.22f * edge_, 4.0f, 16.0f);
  }
  std::vector<Part> make() {
    shell();
    panels();
    for (std::uint32_t i = 0; i < parts_; ++i) list_.push_back(part(i));
    refine();
    for (std::size_t i = 0; i < list_.size(); ++i) {
      list_[i].object = static_cast<std::uint32_t>(i);
    }
    return std::move(list_);
  }
  float edge() const { return edge_; }
  float height() const { return height_; }
  static constexpr float kMargin = 0.5f;  ///< what parts may reach beyond the hall, metres

 private:
  void sheet(std::uint32_t material, const vec3& centre, const vec3& along, const vec3& across,
             float length, float width, float stud) {
    Part p;
    p.shape = Shape::kSheet;
    p.material = material;
    p.caps = false;
    p.centre = centre, p.axis = along, p.side = across;
    p.length = length, p.radius = width, p.second = stud;
    list_.push_back(p);
    weights_.push_back(stud > 0.0f ? 6.0f : 0.0f);
  }
  /// Floor, walls and ceiling; the third axis, along x across, is inwards.
  void shell() {
    const float e = edge_, h = height_;
    const vec3 x(1.0f, 0.0f, 0.0f), y(0.0f, 1.0f, 0.0f), z(0.0f, 0.0f, 1.0f);
    sheet(kConcrete, vec3(0.0f), z, x, e, e, 0.21f);
    sheet(kWhite, vec3(0.0f, h, 0.0f), z, -x, e, e, 0.83f);
    sheet(kWhite, vec3(-0.5f * e, 0.5f * h, 0.0f), y, z, h, e, 0.57f);
    sheet(kWhite, vec3(0.5f * e, 0.5f * h, 0.0f), y, -z, h, e, 0.57f);
    sheet(kConcrete, vec3(0.0f, 0.5f * h, -0.5f * e), y, -x, h, e, 0.39f);
    sheet(kConcrete, vec3(0.0f, 0.5f * h, 0.5f * e), y, x, h, e, 0.39f);
  }
  void panels() {
    constexpr int kAcross = 4;
    for (int i = 0; i < kAcross * kAcross; ++i) {
      const float x = (static_cast<float>(i % kAcross) + 0.5f) / kAcross - 0.5f;
      const float z = (static_cast<float>(i / kAcross) + 0.5f) / kAcross - 0.5f;
      sheet(kGlow, vec3(x * edge_, height_ - 0.4f, z * edge_), vec3(0.0f, 0.0f, 1.0f),
            vec3(-1.0f, 0.0f, 0.0f), 0.12f * edge_, 0.05f * edge_, 0.0f);
    }
  }

  Part part(std::uint32_t i) {
    Draw draw(seed_ * 0x100000001b3ull + i);
    Part p;
    const float kind = draw.unit();
    p.shape = kind < 0.22f   ? Shape::kPipe
              : kind < 0.36f ? Shape::kSpring
              : kind < 0.50f ? Shape::kTank
              : kind < 0.66f ? Shape::kPlate
              : kind < 0.82f ? Shape::kBolt
                             : Shape::kGear;
    p.caps = p.shape != Shape::kGear;
    const std::uint32_t cell = i % (cells_ * cells_), layer = i / (cells_ * cells_);
    const float pitch = edge_ / static_cast<float>(cells_);
    p.centre = vec3((static_cast<float>(cell % cells_) + draw.between(0.3f, 0.7f)) * pitch,
                    draw.between(0.45f, 0.7f) + 1.1f * static_cast<float>(layer),
                    (static_cast<float>(cell / cells_) + draw.between(0.3f, 0.7f)) * pitch) -
               vec3(0.5f * edge_, 0.0f, 0.5f * edge_);
    orient(draw, p);
    p.phase = draw.unit() * kTau;
    p.material =
        kFirstOfParts + static_cast<std::uint32_t>(draw.unit() * static_cast<float>(kOfParts));
    dimension(draw, pitch, p);
    return p;
  }
  static void orient(Draw& draw, Part& p) {
    const float yaw = draw.unit() * kTau, tilt = draw.unit();
    const vec3 level(std::cos(yaw), 0.0f, std::sin(yaw)), up(0.0f, 1.0f, 0.0f);
    p.axis = tilt < 0.5f ? up : level;
    p.side = tilt < 0.5f ? level : up;
    if (p.shape == Shape::kPlate) p.axis = level, p.side = glm::cross(level, up);
  }
  void dimension(Draw& draw, float pitch, Part& p) {
    float weight = 1.0f;
    const float room = 0.42f * std::min(pitch, 1.0f);
    switch (p.shape) {
      case Shape::kPipe:
        overhead(draw, p);
        weight = 2.0f;
        break;
      case Shape::kSpring:
        p.second = draw.scaled(0.15f, 0.8f) * room;
        p.radius = p.second * draw.between(0.1f, 0.22f);
        p.turns = std::floor(draw.between(4.0f, 11.0f));
        p.length = 2.3f * p.radius * p.turns * draw.between(1.0f, 1.5f);
        break;
      case Shape::kTank:
        p.radius = draw.scaled(0.2f, 0.9f) * room;
        p.length = p.radius * draw.between(2.0f, 3.0f);
        p.turns = std::floor(draw.between(6.0f, 16.0f));
        break;
      case Shape::kPlate:
        p.radius = draw.scaled(0.3f, 1.0f) * room;
        p.length = 2.0f * p.radius * draw.between(0.7f, 1.2f);
        p.second = 0.04f * p.radius;
        p.turns = std::floor(draw.between(4.0f, 10.0f));
        break;
      case Shape::kBolt:
        p.radius = draw.scaled(0.02f, 0.3f) * room;
        p.length = 5.0f * p.radius;
        p.turns = std::floor(draw.between(9.0f, 20.0f));
        weight = 0.3f;
        break;
      default:  // a gear
        p.radius = draw.scaled(0.15f, 0.85f) * room;
        p.second = p.radius * draw.between(0.3f, 0.6f);
        p.length = p.radius * draw.between(0.25f, 0.6f);
        p.turns = std::floor(draw.between(12.0f, 40.0f));
    }
    weights_.push_back(weight);
  }
  /// Pipes run through the hall above everything else, or stand in it.
  void overhead(Draw& draw, Part& p) const {
    p.length = std::min(draw.scaled(1.0f, 20.0f), 0.8f * edge_);
    p.radius = draw.scaled(0.02f, 0.12f);
    p.second = draw.between(0.0f, 0.3f);
    p.turns = std::ceil(p.length / draw.between(0.7f, 2.0f));
    const bool alongX = draw.unit() < 0.5f;
    p.axis = alongX ? vec3(1.0f, 0.0f, 0.0f) : vec3(0.0f, 0.0f, 1.0f);
    p.side = vec3(0.0f, -1.0f, 0.0f);
    p.centre.y = draw.between(0.62f, 0.85f) * height_;
    const float reach = std::max(0.0f, 0.5f * (edge_ - p.length));
    float& along = alongX ? p.centre.x : p.centre.z;
    along = std::clamp(along, -reach, reach);
  }

  /// Gives every part its share of the triangles as rows of quads, about as long as wide.
  void refine() {
    double total = 0.0;
    for (const float w : weights_) total += w;
    for (std::size_t i = 0; i < list_.size(); ++i) {
      Part& p = list_[i];
      if (weights_[i] == 0.0f) {
        p.around = p.along = 1;
        continue;
      }
      const double quads = std::max(24.0, 0.5 * triangles_ * weights_[i] / total);
      const double ratio = std::clamp(aspect(p), 0.02, 50.0);
      p.around = std::max(6u, static_cast<std::uint32_t>(std::sqrt(quads / ratio)));
      p.along = std::max(4u, static_cast<std::uint32_t>(std::round(quads / p.around)));
    }
  }
  /// Length along over length around.
  static double aspect(const Part& p) {
    switch (p.shape) {
      case Shape::kSheet:
        return p.length / p.radius;
      case Shape::kPlate:
        return p.length / (4.0 * p.radius);
      case Shape::kSpring:
        return p.turns * p.second / p.radius;
      case Shape::kGear:
        return (p.radius - p.second + p.length) / (4.0 * p.radius);
      default:
        return p.length / (6.28 * p.radius);
    }
  }

  double triangles_;
  std::uint64_t seed_;
  std::uint32_t parts_, cells_;
  float edge_, height_;
  std::vector<Part> list_;
  std::vector<float> weights_;
};

class Assembly : public TriangleStream {
 public:
  Assembly(const SynthRequest& request, const std::string& name) {
    Layout layout(request.triangles, request.seed);
    parts_ = layout.make();
    const double half = 0.5 * layout.edge() + Layout::kMargin;
    bounds_ = {dvec3(-half, -Layout::kMargin, -half),
               dvec3(half, layout.height() + Layout::kMargin, half)};
    for (const Part& p : parts_) reachOut(p);
    for (std::size_t i = 0; i < parts_.size(); ++i) cut(static_cast<std::uint32_t>(i));
    describe(layout, name);
  }
  const Scene& scene() const override { return scene_; }
  Box3d bounds() const override { return bounds_; }
  std::uint64_t triangleCount() const override { return triangles_; }
  std::uint64_t batchCount() const override { return slabs_.size(); }
  std::string key() const override { return scene_.source; }
  std::uint64_t residentBytes() const override {
    return parts_.size() * (sizeof(Part) + 64) + slabs_.size() * sizeof(Slab);
  }
  void batch(std::uint64_t number, TriangleBatch& out) const override {
    out.clear();
    const Slab& s = slabs_[number];
    for (std::uint32_t i = s.firstPart; i < s.endPart; ++i) {
      const Part& p = parts_[i];
      const bool whole = s.endPart - s.firstPart > 1;
      mesh(p, whole ? 0 : s.firstRow, whole ? p.along : s.endRow, out);
    }
  }

 private:
  /// Several whole parts, or rows of one.
  struct Slab {
    std::uint32_t firstPart, endPart, firstRow, endRow;
    std::uint64_t triangles;
  };

  /// Widens the bounds where a part, such as a long spring at a wall, reaches beyond them.
  void reachOut(const Part& p) {
    if (p.shape == Shape::kSheet) return;  // shell and panels
    const dvec3 centre(p.centre), most(0.5 * p.length + p.radius + p.second);
    if (glm::all(glm::greaterThanEqual(centre - most, bounds_.lower)) &&
        glm::all(glm::lessThanEqual(centre + most, bounds_.upper))) {
      return;
    }
    const PartMesher mesher(p);
    std::vector<vec3> row;
    for (std::uint32_t j = 0; j <= p.along; ++j) {
      mesher.row(j, row);
      for (const vec3& v : row) bounds_.extend(dvec3(v));
    }
  }

  void cut(std::uint32_t i) {
    constexpr std::uint64_t kSlab = 1u << 15;
    const Part& p = parts_[i];
    triangles_ += p.triangles();
    if (p.triangles() <= kSlab) {
      const bool joins = !slabs_.empty() && slabs_.back().firstRow == 0 &&
                         slabs_.back().endRow == parts_[slabs_.back().endPart - 1].along &&
                         slabs_.back().triangles + p.triangles() <= kSlab;
      if (joins) {
        slabs_.back().endPart = i + 1;
        slabs_.back().endRow = p.along;
        slabs_.back().triangles += p.triangles();
      } else {
        slabs_.push_back({i, i + 1, 0, p.along, p.triangles()});
      }
      return;
    }
    const auto rows =
        static_cast<std::uint32_t>(std::max<std::uint64_t>(1, kSlab / (2ull * p.around)));
    for (std::uint32_t row = 0; row < p.along; row += rows) {
      slabs_.push_back({i, i + 1, row, std::min(p.along, row + rows), kSlab});
    }
  }

  static void mesh(const Part& p, std::uint32_t firstRow, std::uint32_t endRow,
                   TriangleBatch& out) {
    const PartMesher mesher(p);
    const std::size_t before = out.triangles();
    std::vector<vec3> below, above;
    mesher.row(firstRow, below);
    for (std::uint32_t j = firstRow; j < endRow; ++j) {
      mesher.row(j + 1, above);
      const bool first = p.caps && j == 0, last = p.caps && j + 1 == p.along;
      for (std::uint32_t i = 0; i < p.around; ++i) {
        const vec3 &a = below[i], &b = below[i + 1], &c = above[i + 1], &d = above[i];
        if (first) {
          out.positions.insert(out.positions.end(), {a, c, d});
        } else if (last) {
          out.positions.insert(out.positions.end(), {a, b, d});
        } else {
          addQuad(out.positions, a, b, c, d);
        }
      }
      below.swap(above);
    }
    out.runs.push_back({p.material, p.object, out.triangles() - before});
  }

  void describe(const Layout& layout, const std::string& name) {
    scene_.source = name;
    scene_.materials = {synthMaterial("concrete", vec3(0.42f, 0.41f, 0.39f), 0.0f, 1.0f),
                        synthMaterial("steel", vec3(0.72f, 0.72f, 0.74f), 1.0f, 0.32f),
                        synthMaterial("brass", vec3(0.86f, 0.66f, 0.32f), 1.0f, 0.25f),
                        synthMaterial("red paint", vec3(0.62f, 0.07f, 0.05f), 0.0f, 0.45f),
                        synthMaterial("yellow paint", vec3(0.78f, 0.56f, 0.06f), 0.0f, 0.4f),
                        synthMaterial("rubber", vec3(0.05f, 0.05f, 0.055f), 0.0f, 0.9f),
                        synthMaterial("white paint", vec3(0.75f, 0.75f, 0.73f), 0.0f, 0.6f),
                        synthMaterial("panel", vec3(0.8f), 0.0f, 1.0f)};
    scene_.materials[kGlow].emission = vec3(22.0f, 20.5f, 18.0f);
    for (const Part& p : parts_) {
      scene_.objects.push_back(
          fmt::format("{} {}", kShapeNames[static_cast<std::size_t>(p.shape)], p.object));
      if (p.material == kGlow) addPanel(p);
    }
    // The rest stands for itself with one mesh a material, without arrays.
    for (std::uint32_t m = 0; m < kGlow; ++m) {
      Instance instance;
      instance.name = scene_.materials[m].name;
      instance.mesh = static_cast<int>(scene_.meshes.size());
      scene_.meshes.emplace_back().name = instance.name;
      scene_.meshes.back().material = static_cast<int>(m);
      scene_.instances.push_back(std::move(instance));
    }
    const double e = layout.edge(), h = layout.height();
    scene_.cameras = {
        synthCamera("hall", dvec3(-0.47 * e, 0.55 * h, 0.47 * e),
                    dvec3(0.12 * e, 0.05 * h, -0.1 * e), 50.0f),
        synthCamera("floor", dvec3(-0.3, 1.4, 0.42 * e), dvec3(0.4, 0.9, 0.0), 45.0f)};
  }
  void addPanel(const Part& p) {
    TriangleBatch panel;
    mesh(p, 0, p.along, panel);
    Mesh m;
    m.name = scene_.objects.back();
    m.material = kGlow;
    m.positions = panel.positions;
    for (std::uint32_t i = 0; i < m.positions.size(); i += 3)
      m.triangles.push_back({i, i + 1, i + 2});
    Instance instance;
    instance.name = m.name;
    instance.mesh = static_cast<int>(scene_.meshes.size());
    instance.object = static_cast<int>(p.object);
    scene_.meshes.push_back(std::move(m));
    scene_.instances.push_back(std::move(instance));
  }

  std::vector<Part> parts_;
  std::vector<Slab> slabs_;
  Box3d bounds_;
  std::uint64_t triangles_ = 0;
  Scene scene_;
};

}  // namespace

std::unique_ptr<TriangleStream> makeAssembly(const SynthRequest& request, const std::string& name) {
  return std::make_unique<Assembly>(request, name);
}

}  // namespace trex::detail
