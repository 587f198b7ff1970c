#include "src/scene/gltf_pose.h"

#include <algorithm>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/quaternion.hpp>

namespace trex::detail {
namespace {

/// Joints that one vertex may have: JOINTS_0 to JOINTS_3.
constexpr int kMostJointSets = 4;

const tinygltf::Animation& animationOf(const GltfContext& context) {
  const auto& animations = context.model.animations;
  const std::string& wanted = context.options.animation;
  std::string names;
  for (std::size_t i = 0; i < animations.size(); ++i) {
    if (animations[i].name == wanted || std::to_string(i) == wanted) return animations[i];
    if (i < 20) names += (i > 0 ? ", " : "") + fmt::format("{} '{}'", i, animations[i].name);
  }
  fail(ExitCode::kUsage, "{}: has no animation '{}'; it has {}", context.name, wanted,
       names.empty() ? "none" : names);
}

std::vector<double> elementOf(const GltfAccessor& a, std::uint64_t first, std::uint64_t count) {
  std::vector<double> out;
  for (std::uint64_t e = first; e < first + count; ++e) {
    for (int c = 0; c < a.components(); ++c) out.push_back(double{a.value(e, c)});
  }
  return out;
}

/// The matrix of element i of an accessor of MAT4.
dmat4 matrixAt(const GltfAccessor& a, std::uint64_t i) {
  dmat4 m(1.0);
  for (int c = 0; c < 16; ++c) m[c / 4][c % 4] = double{a.value(i, c)};
  return m;
}

void morph(const GltfContext& context, const tinygltf::Primitive& p,
           const std::vector<std::uint32_t>& used, const std::vector<float>& weights, Mesh& mesh) {
  const auto add = [&](std::size_t target, const char* name, std::vector<vec3>& values) {
    const auto found = p.targets[target].find(name);
    if (found == p.targets[target].end() || values.empty() || weights[target] == 0.0f) return;
    const GltfAccessor moved(context, found->second);
    if (moved.components() != 3) context.bad("morph target {}: {} is no VEC3", target, name);
    for (std::size_t i = 0; i < used.size(); ++i) {
      if (used[i] >= moved.count()) {
        context.bad("morph target {}: {} has {} elements", target, name, moved.count());
      }
      for (int k = 0; k < 3; ++k) values[i][k] += weights[target] * moved.value(used[i], k);
    }
  };
  for (std::size_t t = 0; t < std::min(p.targets.size(), weights.size()); ++t) {
    add(t, "POSITION", mesh.positions);
    add(t, "NORMAL", mesh.normals);
  }
}

/// Sum of the joints' matrices by a vertex's weights, which are made to add up to 1.
class Blend {
 public:
  Blend(const GltfContext& context, const tinygltf::Primitive& p, const std::vector<dmat4>& joints,
        const std::string& where)
      : context_(context), joints_(joints), where_(where) {
    for (int set = 0; set < kMostJointSets; ++set) {
      const auto j = p.attributes.find(fmt::format("JOINTS_{}", set));
      const auto w = p.attributes.find(fmt::format("WEIGHTS_{}", set));
      if (j == p.attributes.end() || w == p.attributes.end()) break;
      sets_.push_back({GltfAccessor(context, j->second), GltfAccessor(context, w->second)});
      const auto& [numbers, weights] = sets_.back();
      if (numbers.components() != 4 || weights.components() != 4) {
        context.bad("{}: JOINTS_{} and WEIGHTS_{} must be VEC4", where, set, set);
      }
    }
  }
  bool empty() const { return sets_.empty(); }

  dmat4 at(std::uint32_t vertex) const {
    dmat4 sum(0.0);
    double total = 0.0;
    for (const auto& [numbers, weights] : sets_) {
      if (vertex >= numbers.count() || vertex >= weights.count()) {
        context_.bad("{}: vertex {} has no joints", where_, vertex);
      }
      for (int k = 0; k < 4; ++k) {
        const double weight = double{weights.value(vertex, k)};
        if (!(weight > 0.0)) continue;
        const auto joint = static_cast<std::size_t>(numbers.value(vertex, k));
        if (joint >= joints_.size()) {
          context_.bad("{}: vertex {} has joint {}, but there are {}", where_, vertex, joint,
                       joints_.size());
        }
        sum += weight * joints_[joint];
        total += weight;
      }
    }
    return total > 0.0 ? sum / total : joints_.front();
  }

 private:
  const GltfContext& context_;
  const std::vector<dmat4>& joints_;
  const std::string& where_;
  std::vector<std::pair<GltfAccessor, GltfAccessor>> sets_;
};

}  // namespace

GltfPose::GltfPose(GltfContext& context) : context_(context) {
  if (context.options.animation.empty()) return;
  moved_.resize(context.model.nodes.size());
  animate(animationOf(context), context.options.atSeconds);
}

void GltfPose::animate(const tinygltf::Animation& animation, double seconds) {
  for (const tinygltf::AnimationChannel& channel : animation.channels) {
    if (channel.target_node == -1) continue;  // of an extension
    context_.attempt("that channel of the animation is left out", [&] {
      if (channel.target_node < 0 || std::size_t(channel.target_node) >= moved_.size() ||
          channel.sampler < 0 || std::size_t(channel.sampler) >= animation.samplers.size()) {
        context_.bad("animation '{}': a channel's node or sampler does not exist", animation.name);
      }
      move(channel, valueAt(animation.samplers[channel.sampler], seconds,
                            channel.target_path == "rotation"));
    });
  }
}

void GltfPose::move(const tinygltf::AnimationChannel& channel, const std::vector<double>& value) {
  Moved& moved = moved_[channel.target_node];
  const std::size_t wanted = channel.target_path == "rotation"  ? 4
                             : channel.target_path == "weights" ? value.size()
                                                                : 3;
  if (value.size() != wanted) {
    context_.bad("an animation of {} has values of {} numbers", channel.target_path, value.size());
  }
  if (channel.target_path == "translation") moved.translation = {value[0], value[1], value[2]};
  if (channel.target_path == "scale") moved.scale = {value[0], value[1], value[2]};
  if (channel.target_path == "rotation") {
    moved.rotation = glm::dquat(value[3], value[0], value[1], value[2]);
  }
  if (channel.target_path == "weights") moved.weights.assign(value.begin(), value.end());
}

/// The sampler's value [glTF 2.0, appendix C]: of the first key before it begins, of the last after
/// its end.
std::vector<double> GltfPose::valueAt(const tinygltf::AnimationSampler& sampler, double seconds,
                                      bool rotation) const {
  const GltfAccessor times(context_, sampler.input), values(context_, sampler.output);
  const bool cubic = sampler.interpolation == "CUBICSPLINE";
  const std::uint64_t keys = times.count(), rows = keys * (cubic ? 3 : 1);
  if (times.components() != 1 || values.count() < rows) {
    context_.bad("an animation has {} times for {} values", keys, values.count());
  }
  const std::uint64_t size = values.count() / rows;  // elements of a key: several of weights
  std::uint64_t next = 0;
  while (next < keys && double{times.value(next, 0)} <= seconds) ++next;
  const auto row = [&](std::uint64_t key, std::uint64_t part) {
    return elementOf(values, (cubic ? 3 * key + part : key) * size, size);
  };
  if (next == 0) return row(0, 1);
  if (next == keys || sampler.interpolation == "STEP") return row(next - 1, 1);
  const double begin = double{times.value(next - 1, 0)}, step = times.value(next, 0) - begin;
  const double t = step > 0.0 ? (seconds - begin) / step : 0.0;
  std::vector<double> a = row(next - 1, 1);
  const std::vector<double> b = row(next, 1);
  if (cubic) {
    const std::vector<double> leaving = row(next - 1, 2), arriving = row(next, 0);
    const double t2 = t * t, t3 = t2 * t;
    for (std::size_t i = 0; i < a.size(); ++i) {
      a[i] = (2.0 * t3 - 3.0 * t2 + 1.0) * a[i] + step * (t3 - 2.0 * t2 + t) * leaving[i] +
             (3.0 * t2 - 2.0 * t3) * b[i] + step * (t3 - t2) * arriving[i];
    }
  } else if (rotation && a.size() == 4) {
    const glm::dquat q =
        glm::slerp(glm::dquat(a[3], a[0], a[1], a[2]), glm::dquat(b[3], b[0], b[1], b[2]), t);
    a = {q.x, q.y, q.z, q.w};
  } else {
    for (std::size_t i = 0; i < a.size(); ++i) a[i] += t * (b[i] - a[i]);
  }
  return a;
}

/// The node's matrix, with the last row of an affine one: anything else would divide by w.
dmat4 GltfPose::affine(const tinygltf::Node& node, int index) {
  constexpr double kRounding = 1e-6;
  dmat4 m(1.0);
  for (int i = 0; i < 16; ++i) m[i / 4][i % 4] = node.matrix[i];
  for (int k = 0; k < 4; ++k) {
    const double wanted = k == 3 ? 1.0 : 0.0;
    if (!(std::abs(m[k][3] - wanted) <= kRounding)) {
      context_.replace("node {} ('{}'): its matrix is not affine; its last row is left out", index,
                       node.name);
    }
    m[k][3] = wanted;
  }
  return m;
}

dmat4 GltfPose::local(int index) {
  const tinygltf::Node& node = context_.model.nodes[index];
  const auto sized = [&](const std::vector<double>& v, std::size_t size, const char* what) {
    if (!v.empty() && v.size() != size) {
      context_.replace("node {} ('{}'): {} must have {} numbers; none is used", index, node.name,
                       what, size);
    }
    return v.size() == size;
  };
  Moved at;
  if (sized(node.matrix, 16, "matrix")) return affine(node, index);
  if (sized(node.translation, 3, "translation")) {
    at.translation = {node.translation[0], node.translation[1], node.translation[2]};
  }
  if (sized(node.scale, 3, "scale")) at.scale = {node.scale[0], node.scale[1], node.scale[2]};
  if (sized(node.rotation, 4, "rotation")) {
    at.rotation =
        glm::dquat(node.rotation[3], node.rotation[0], node.rotation[1], node.rotation[2]);
  }
  if (!moved_.empty()) {
    const Moved& moved = moved_[index];
    if (moved.translation) at.translation = moved.translation;
    if (moved.scale) at.scale = moved.scale;
    if (moved.rotation) at.rotation = moved.rotation;
  }
  dmat4 m(1.0);
  if (at.rotation) {
    const double length = glm::length(*at.rotation);
    if (length > 0.0 && std::isfinite(length)) {
      m = glm::mat4_cast(*at.rotation / length);
    } else {
      context_.replace("node {} ('{}'): its rotation has no length; none is used", index,
                       node.name);
    }
  }
  for (int k = 0; at.scale && k < 3; ++k) m[k] *= (*at.scale)[k];
  if (at.translation) m[3] = glm::dvec4(*at.translation, 1.0);
  return m;
}

std::vector<float> GltfPose::weights(int index) const {
  if (!moved_.empty() && !moved_[index].weights.empty()) return moved_[index].weights;
  const tinygltf::Node& node = context_.model.nodes[index];
  const auto& meshes = context_.model.meshes;
  const std::vector<double>& given =
      !node.weights.empty() || node.mesh < 0 || std::size_t(node.mesh) >= meshes.size()
          ? node.weights
          : meshes[node.mesh].weights;
  const bool any = std::any_of(given.begin(), given.end(), [](double w) { return w != 0.0; });
  return any ? std::vector<float>(given.begin(), given.end()) : std::vector<float>();
}

std::vector<dmat4> skinMatrices(GltfContext& context, int number, const std::vector<dmat4>& world) {
  const auto& skins = context.model.skins;
  if (number < 0 || std::size_t(number) >= skins.size()) {
    context.bad("skin {} does not exist; there are {}", number, skins.size());
  }
  const tinygltf::Skin& skin = skins[number];
  if (skin.joints.empty()) context.bad("skin {} has no joints", number);
  std::optional<GltfAccessor> inverse;
  if (skin.inverseBindMatrices >= 0) inverse.emplace(context, skin.inverseBindMatrices);
  if (inverse && (inverse->components() != 16 || inverse->count() < skin.joints.size())) {
    context.bad("skin {}: inverseBindMatrices has no MAT4 for each joint", number);
  }
  std::vector<dmat4> out;
  for (std::size_t i = 0; i < skin.joints.size(); ++i) {
    const int joint = skin.joints[i];
    if (joint < 0 || std::size_t(joint) >= world.size()) {
      context.bad("skin {}: joint {} does not exist", number, joint);
    }
    out.push_back(inverse ? world[joint] * matrixAt(*inverse, i) : world[joint]);
  }
  return out;
}

void deform(GltfContext& context, const tinygltf::Primitive& p,
            const std::vector<std::uint32_t>& used, const GltfDeformation& deformation,
            const std::string& where, LocalFrame& frame, Mesh& mesh) {
  morph(context, p, used, deformation.weights, mesh);
  if (deformation.joints.empty()) return;
  const Blend blend(context, p, deformation.joints, where);
  if (blend.empty()) {
    context.replace("{}: is skinned, but has no JOINTS_0 and WEIGHTS_0; it is shown unbent", where);
    return;
  }
  for (std::size_t i = 0; i < used.size(); ++i) {
    const dmat4 m = blend.at(used[i]);
    mesh.positions[i] = frame.toLocal(dvec3(m * glm::dvec4(dvec3(mesh.positions[i]), 1.0)));
    if (mesh.normals.empty()) continue;
    const glm::dmat3 l(m);
    const glm::dmat3 cofactor(glm::cross(l[1], l[2]), glm::cross(l[2], l[0]),
                              glm::cross(l[0], l[1]));
    const dvec3 n = cofactor * dvec3(mesh.normals[i]);
    const double length = glm::length(n);
    mesh.normals[i] = length > 0.0 && std::isfinite(length) ? vec3(n / length) : vec3(0.0f);
  }
  mesh.origin = frame.origin();
}

}  // namespace trex::detail
