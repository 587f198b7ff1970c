// Time of the filter, as JSON on stdout: whole, its constructor, the longest slice
// between two chances to stop, and how much longer the plain scalar filter takes. Medians of runs
// by turns. Usage: filter_bench [--size 640x360] [--repeats 5]
//
// Two pictures: "room", a box with spheres in it, textured and with an open window, and "even",
// where every neighbour counts.
#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <cstdlib>
#include <optional>
#include <random>
#include <string_view>
#include <vector>

#include "src/frame/denoise.h"
#include "tests/unit/scalar_filter.h"

namespace {

using namespace trex;

struct Options {
  std::uint32_t width = 640, height = 360;
  int repeats = 5;
};

struct Input {
  FeatureImage features;
  std::vector<vec3> radiance, variance;
};

/// What a ray from the origin, in a box of [-2, 2]^3 with spheres, meets; nothing in the window.
Feature firstHit(const vec3& direction, float pixel) {
  Feature f;
  float nearest = kInfinity;
  for (int axis = 0; axis < 3; ++axis) {
    const float t = 2.0f / std::abs(direction[axis]);
    if (t >= nearest) continue;
    nearest = t;
    f.normal = vec3(0.0f);
    f.normal[axis] = direction[axis] > 0.0f ? -1.0f : 1.0f;
  }
  f.position = nearest * direction;
  if (f.normal.z != 0.0f && f.position.x > 0.2f && f.position.y > 0.2f && f.position.y < 0.8f) {
    return {};
  }
  const vec3 square = glm::floor(f.position * 4.0f + 0.01f);
  f.albedo = std::fmod(std::abs(square.x + square.y + square.z), 2.0f) > 0.5f
                 ? vec3(0.8f, 0.7f, 0.6f)
                 : vec3(0.3f);
  for (int i = 0; i < 5; ++i) {
    const vec3 centre(-1.2f + 0.6f * static_cast<float>(i), -0.5f, 1.4f);
    const float along = glm::dot(centre, direction);
    const float inside = 0.09f - glm::dot(centre, centre) + along * along;
    if (inside <= 0.0f || along - std::sqrt(inside) >= nearest) continue;
    nearest = along - std::sqrt(inside);
    f.position = nearest * direction;
    f.normal = (f.position - centre) / 0.3f;
    f.albedo = vec3(0.5f);
  }
  f.footprint = nearest * pixel;
  return f;
}

Input room(const Options& o) {
  Input in{FeatureImage(o.width, o.height), {}, {}};
  std::mt19937 random(1);
  std::normal_distribution<float> noise(0.0f, 0.3f);
  const float pixel = 1.6f / static_cast<float>(o.width);
  for (std::uint32_t y = 0; y < o.height; ++y) {
    for (std::uint32_t x = 0; x < o.width; ++x) {
      const vec3 direction = glm::normalize(
          vec3((static_cast<float>(x) - static_cast<float>(o.width) / 2.0f) * pixel,
               (static_cast<float>(o.height) / 2.0f - static_cast<float>(y)) * pixel, 1.0f));
      const Feature f = firstHit(direction, pixel);
      in.features.add(x, y, f);
      const vec3 light = f.albedo * (1.0f + 0.5f * f.normal.y);
      in.radiance.push_back(light * (1.0f + noise(random)));
      in.variance.push_back(light * light * 0.09f);
    }
  }
  return in;
}

Input even(const Options& o) {
  const std::vector<vec3> ones(std::size_t{o.width} * o.height, vec3(1.0f));
  return {FeatureImage(o.width, o.height), ones, ones};
}

double medianOf(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  return values[values.size() / 2];
}

class Milliseconds {
 public:
  template <typename Function>
  void add(Function function) {
    const auto start = std::chrono::steady_clock::now();
    function();
    const auto end = std::chrono::steady_clock::now();
    values_.push_back(std::chrono::duration<double, std::milli>(end - start).count());
  }
  double median() const { return medianOf(values_); }
  double longest() const { return *std::max_element(values_.begin(), values_.end()); }

 private:
  std::vector<double> values_;
};

std::string measure(const Input& in, int repeats) {
  Milliseconds scalar, whole, constructor;
  std::vector<double> longest;
  for (int i = 0; i < repeats; ++i) {
    scalar.add([&] { test::ScalarFilter(in.features, in.radiance, in.variance).run(false); });
    whole.add([&] { denoiseGuess(in.features, in.radiance, in.variance); });
    std::optional<GuessFilter> filter;
    constructor.add([&] { filter.emplace(in.features, in.radiance, in.variance, false); });
    Milliseconds slices;
    for (bool done = false; !done;) {
      slices.add([&] { done = filter->advance([] { return false; }); });
    }
    longest.push_back(slices.longest());
  }
  return fmt::format(
      "{{\"filter_ms\": {:.2f}, \"constructor_ms\": {:.2f}, \"longest_slice_ms\": {:.2f}, "
      "\"scalar_ms\": {:.2f}, \"ratio\": {:.2f}}}",
      whole.median(), constructor.median(), medianOf(longest), scalar.median(),
      scalar.median() / whole.median());
}

Options parse(int argc, char** argv) {
  Options o;
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string_view key = argv[i];
    if (key == "--size") std::sscanf(argv[i + 1], "%ux%u", &o.width, &o.height);
    if (key == "--repeats") o.repeats = std::max(1, std::atoi(argv[i + 1]));
  }
  return o;
}

}  // namespace

int main(int argc, char** argv) {
  const Options o = parse(argc, argv);
  fmt::print("{{\"width\": {}, \"height\": {}, \"repeats\": {}, \"room\": {}, \"even\": {}}}\n",
             o.width, o.height, o.repeats, measure(room(o), o.repeats),
             measure(even(o), o.repeats));
}
