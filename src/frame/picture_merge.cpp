#include "src/frame/picture_merge.h"

#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "src/core/error.h"
#include "src/frame/picture_reader.h"

namespace trex {
namespace {

std::string* find(Picture& picture, const std::string& key) {
  for (auto& [name, value] : picture.metadata) {
    if (name == key) return &value;
  }
  return nullptr;
}

void put(Picture& picture, const std::string& key, const std::string& text) {
  if (std::string* value = find(picture, key)) {
    *value = text;
  } else {
    picture.metadata.emplace_back(key, text);
  }
}

std::uint64_t number(const std::string& text) { return std::strtoull(text.c_str(), nullptr, 10); }

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    parts.push_back(text.substr(at, end - at));
    at = end + 1;
  }
  return parts;
}

void checkLayers(const Picture& picture, const std::string& name) {
  for (const char* layer :
       {"R", "G", "B", "sampleCount", "variance.R", "variance.G", "variance.B"}) {
    if (channelIndex(picture, layer) >= 0) continue;
    fail(ExitCode::kInput, "{}: has no layer {}; render it with --aov variance,sampleCount", name,
         layer);
  }
}

void checkValues(const Picture& picture, const std::string& name) {
  const std::size_t stride = picture.channels.size();
  const auto count = static_cast<std::size_t>(channelIndex(picture, "sampleCount"));
  for (std::size_t i = 0; i < picture.values.size(); ++i) {
    const std::size_t pixel = i / stride, x = pixel % picture.width, y = pixel / picture.width;
    const float value = picture.values[i];
    if (!std::isfinite(value)) {
      fail(ExitCode::kInput, "{}: {} of pixel {},{} is not finite", name,
           picture.channels[i % stride], x, y);
    }
    if (i % stride == count && (value < 0.0f || value != std::floor(value))) {
      fail(ExitCode::kInput, "{}: sampleCount of pixel {},{} is {}, no count", name, x, y, value);
    }
  }
}

}  // namespace

void PictureMerger::add(const Picture& picture, const std::string& name) {
  checkLayers(picture, name);
  if (isDenoised(picture)) {
    fail(ExitCode::kInput, "{}: is denoised; render it with --denoise off", name);
  }
  checkValues(picture, name);
  if (seeds_.empty()) {
    start(picture, name);
  } else {
    checkFits(picture, name);
  }
  takeMetadata(picture, name);
  accumulate(picture, name);
}

void PictureMerger::start(const Picture& picture, const std::string& name) {
  first_ = picture;
  firstName_ = name;
  countChannel_ = channelIndex(picture, "sampleCount");
  counts_.assign(std::size_t{picture.width} * picture.height, 0.0);
  sums_.assign(picture.values.size(), 0.0);
  for (const std::string& channel : picture.channels) {
    const bool variance = channel.starts_with("variance.");
    const bool color = channel == "R" || channel == "G" || channel == "B";
    const int of = variance ? channelIndex(picture, channel.substr(9)) : -1;
    colorOfVariance_.push_back(of);
    rules_.push_back(channel == "sampleCount"                           ? Rule::kCount
                     : channel == "objectId" || channel == "materialId" ? Rule::kFirst
                     : of >= 0                                          ? Rule::kVariance
                     : color                                            ? Rule::kColor
                                                                        : Rule::kMean);
  }
}

void PictureMerger::checkFits(const Picture& picture, const std::string& name) const {
  if (picture.width != first_.width || picture.height != first_.height) {
    fail(ExitCode::kInput, "{}: is {}x{}, but {} is {}x{}", name, picture.width, picture.height,
         firstName_, first_.width, first_.height);
  }
  for (const std::string& channel : first_.channels) {
    if (channelIndex(picture, channel) >= 0) continue;
    fail(ExitCode::kInput, "{}: has no layer {}, but {} has", name, channel, firstName_);
  }
  for (const std::string& channel : picture.channels) {
    if (channelIndex(first_, channel) >= 0) continue;
    fail(ExitCode::kInput, "{}: has a layer {}, but {} has not", name, channel, firstName_);
  }
  for (const char* key : {"trex:scene", "trex:camera", "trex:environment", "trex:exact",
                          "trex:maxBounces", "trex:transparent"}) {
    const std::string mine = metadataOf(picture, key), other = metadataOf(first_, key);
    if (mine == other) continue;
    fail(ExitCode::kInput, "{}: {} is \"{}\", but \"{}\" in {}; only one view can be merged", name,
         key, mine, other, firstName_);
  }
}

void PictureMerger::takeMetadata(const Picture& picture, const std::string& name) {
  const std::string seed = metadataOf(picture, "trex:seed");
  if (seed.empty()) fail(ExitCode::kInput, "{}: has no seed (metadata trex:seed)", name);
  for (const std::string& one : split(seed)) {
    if (std::find(seeds_.begin(), seeds_.end(), one) != seeds_.end()) {
      fail(ExitCode::kInput, "{}: seed {} is in already; render with another --seed", name, one);
    }
    seeds_.push_back(one);
  }
  samples_ += number(metadataOf(picture, "trex:samples"));
  nonFinite_ += number(metadataOf(picture, "trex:nonFiniteSamples"));
}

void PictureMerger::accumulate(const Picture& picture, const std::string&) {
  const std::size_t stride = first_.channels.size();
  std::vector<std::size_t> from;
  for (const std::string& channel : first_.channels) {
    from.push_back(static_cast<std::size_t>(channelIndex(picture, channel)));
  }
  std::vector<double> deltas(stride);
  for (std::size_t pixel = 0; pixel < counts_.size(); ++pixel) {
    const float* in = &picture.values[pixel * stride];
    double* sum = &sums_[pixel * stride];
    const double n = in[from[static_cast<std::size_t>(countChannel_)]];
    if (n == 0.0) continue;
    const double before = counts_[pixel], total = before + n;
    for (std::size_t c = 0; c < stride; ++c) deltas[c] = in[from[c]] - sum[c];
    for (std::size_t c = 0; c < stride; ++c) {
      if (rules_[c] == Rule::kVariance) {
        const double delta = deltas[static_cast<std::size_t>(colorOfVariance_[c])];
        sum[c] += in[from[c]] * n * (n - 1.0) + delta * delta * before * n / total;
      } else {
        sum[c] += deltas[c] * n / total;
      }
    }
    counts_[pixel] = total;
  }
}

Picture PictureMerger::result() const {
  Picture out = first_;
  const std::size_t stride = out.channels.size();
  for (std::size_t i = 0; i < out.values.size(); ++i) {
    const double n = counts_[i / stride];
    double value = sums_[i];
    switch (rules_[i % stride]) {
      case Rule::kFirst:
        continue;
      case Rule::kCount:
        value = n;
        break;
      case Rule::kVariance:
        value = n > 1.0 ? value / (n * (n - 1.0)) : 0.0;
        break;
      case Rule::kMean:
      case Rule::kColor:
        break;
    }
    out.values[i] = static_cast<float>(value);
  }
  put(out, "trex:seed", fmt::format("{}", fmt::join(seeds_, ",")));
  put(out, "trex:samples", std::to_string(samples_));
  if (!metadataOf(out, "trex:nonFiniteSamples").empty()) {
    put(out, "trex:nonFiniteSamples", std::to_string(nonFinite_));
  }
  return out;
}

}  // namespace trex
