#include "src/scene/pbrt_state.h"

#include <algorithm>
#include <cmath>
#include <glm/gtc/matrix_inverse.hpp>
#include <glm/gtc/matrix_transform.hpp>
#include <glm/gtc/type_ptr.hpp>

namespace trex::detail {
namespace {

bool finite(const dmat4& m) {
  const double* values = glm::value_ptr(m);
  return std::all_of(values, values + 16, [](double v) { return std::isfinite(v); });
}

/// Without the rounding errors of whoever wrote it in its last row.
dmat4 affine(dmat4 m) {
  m /= m[3][3];
  for (int k = 0; k < 3; ++k) {
    if (std::abs(m[k][3]) < 1e-9) m[k][3] = 0.0;
  }
  return m;
}

/// World to camera: +z of the camera points at `target`, +y up, and +x is up x view.
std::optional<dmat4> lookAt(const dvec3& eye, const dvec3& target, const dvec3& up) {
  const dvec3 view = glm::normalize(target - eye);
  const dvec3 right = glm::normalize(glm::cross(glm::normalize(up), view));
  const dvec3 straight = glm::cross(view, right);
  const dmat4 cameraToWorld(glm::dvec4(right, 0.0), glm::dvec4(straight, 0.0),
                            glm::dvec4(view, 0.0), glm::dvec4(eye, 1.0));
  if (!finite(cameraToWorld)) return {};
  return glm::affineInverse(cameraToWorld);
}

}  // namespace

std::size_t pbrtTransformNumbers(std::string_view directive) {
  if (directive == "Translate" || directive == "Scale") return 3;
  if (directive == "Rotate") return 4;
  if (directive == "LookAt") return 9;
  if (directive == "Transform" || directive == "ConcatTransform") return 16;
  return 0;
}

std::optional<dmat4> pbrtTransform(std::string_view directive, std::span<const double> n) {
  std::optional<dmat4> made;
  if (directive == "Translate") {
    made = glm::translate(dmat4(1.0), dvec3(n[0], n[1], n[2]));
  } else if (directive == "Scale") {
    made = glm::scale(dmat4(1.0), dvec3(n[0], n[1], n[2]));
  } else if (directive == "Rotate") {
    made = glm::rotate(dmat4(1.0), glm::radians(n[0]), dvec3(n[1], n[2], n[3]));
  } else if (directive == "LookAt") {
    made = lookAt({n[0], n[1], n[2]}, {n[3], n[4], n[5]}, {n[6], n[7], n[8]});
  } else {
    made = affine(glm::make_mat4(n.data()));
  }
  if (made && !finite(*made)) made.reset();
  return made;
}

bool isPlacement(const dmat4& m) {
  const bool affine = m[0][3] == 0.0 && m[1][3] == 0.0 && m[2][3] == 0.0 && m[3][3] == 1.0;
  if (!affine || !finite(m)) return false;
  const double determinant = glm::determinant(glm::dmat3(m));
  return std::isnormal(determinant) && finite(glm::inverse(m));
}

void PbrtState::multiply(const dmat4& m) {
  for (unsigned i = 0; i < ctm.size(); ++i) {
    if ((active >> i & 1u) != 0) ctm[i] = ctm[i] * m;
  }
}

void PbrtState::set(const std::array<dmat4, 2>& to) {
  for (unsigned i = 0; i < ctm.size(); ++i) {
    if ((active >> i & 1u) != 0) ctm[i] = to[i];
  }
}

bool PbrtStack::push(Kind kind) {
  if (saved_.size() >= kMaxDepth) return false;
  saved_.push_back({kind, state_});
  objects_ += kind == Kind::kObject;
  return true;
}

bool PbrtStack::pop(Kind kind) {
  if (saved_.empty() || saved_.back().kind != kind) return false;
  PbrtState& saved = saved_.back().state;
  if (kind == Kind::kTransform) {
    state_.ctm = saved.ctm;
    state_.active = saved.active;
  } else {
    state_ = std::move(saved);
  }
  saved_.pop_back();
  objects_ -= kind == Kind::kObject;
  return true;
}

void PbrtStack::popTo(std::size_t depth) {
  if (depth >= saved_.size()) return;
  state_ = std::move(saved_[depth].state);
  while (saved_.size() > depth) {
    objects_ -= saved_.back().kind == Kind::kObject;
    saved_.pop_back();
  }
}

}  // namespace trex::detail
