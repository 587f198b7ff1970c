#include "src/schedule/timing.h"

#include <algorithm>
#include <cmath>

#include "src/core/error.h"

namespace trex::schedule {
namespace {

constexpr int kRounds = 20;              ///< of new weights
constexpr std::size_t kMostAmounts = 8;  ///< all sets of parameters that are above 0 are tried
constexpr double kHuber = 1.345;         ///< deviations; 95 % efficient for normal errors
constexpr double kNormal = 1.483;  ///< standard deviation over median deviation, of a normal one
/// Of the parameters' squares, against the mean square of a sample: decides what samples leave
/// open.
constexpr double kRidge = 1e-9, kSetupRidge = 1e-7;

void checkSamples(std::span<const TimingSample> samples) {
  if (samples.empty()) fail(ExitCode::kInput, "timing model: there is no sample to fit");
  if (samples[0].amounts.size() > kMostAmounts) {
    fail(ExitCode::kInput, "timing model: {} amounts, at most {} are possible",
         samples[0].amounts.size(), kMostAmounts);
  }
  for (const TimingSample& s : samples) {
    if (s.amounts.size() != samples[0].amounts.size()) {
      fail(ExitCode::kInput, "timing model: a sample has {} amounts, another {}", s.amounts.size(),
           samples[0].amounts.size());
    }
    if (!std::isfinite(s.seconds) || s.seconds <= 0.0) {
      fail(ExitCode::kInput, "timing model: a job of {} seconds", s.seconds);
    }
    if (!std::all_of(s.amounts.begin(), s.amounts.end(), isAmount)) {
      fail(ExitCode::kInput, "timing model: an amount is not finite and at least 0");
    }
  }
}

/// Rows a.x = 1 of relative errors, columns scaled to a mean square of 1.
struct System {
  std::size_t columns = 0;
  std::vector<double> rows, scales;
  double error(std::size_t row, const std::vector<double>& x) const {
    double sum = -1.0;
    for (std::size_t c = 0; c < columns; ++c) sum += rows[row * columns + c] * x[c];
    return sum;
  }
};

System systemOf(std::span<const TimingSample> samples) {
  System s;
  s.columns = samples[0].amounts.size() + 1;
  s.scales.assign(s.columns, 0.0);
  for (const TimingSample& sample : samples) {
    s.rows.push_back(1.0 / sample.seconds);
    for (double amount : sample.amounts) s.rows.push_back(amount / sample.seconds);
  }
  for (std::size_t i = 0; i < s.rows.size(); ++i) {
    s.scales[i % s.columns] += s.rows[i] * s.rows[i] / static_cast<double>(samples.size());
  }
  for (double& scale : s.scales) scale = std::sqrt(scale);
  for (std::size_t i = 0; i < s.rows.size(); ++i) {
    if (s.scales[i % s.columns] > 0.0) s.rows[i] /= s.scales[i % s.columns];
  }
  return s;
}

/// a.x = b for a symmetric positive definite `a` of n rows, by elimination.
std::vector<double> solved(std::vector<double> a, std::vector<double> b) {
  const std::size_t n = b.size();
  for (std::size_t k = 0; k < n; ++k) {
    for (std::size_t i = k + 1; i < n; ++i) {
      const double factor = a[i * n + k] / a[k * n + k];
      for (std::size_t j = k; j < n; ++j) a[i * n + j] -= factor * a[k * n + j];
      b[i] -= factor * b[k];
    }
  }
  for (std::size_t k = n; k-- > 0;) {
    for (std::size_t j = k + 1; j < n; ++j) b[k] -= a[k * n + j] * b[j];
    b[k] /= a[k * n + k];
  }
  return b;
}

/// Normal equations of the rows with their weights.
struct Normal {
  std::vector<double> matrix, right;
};

Normal normalOf(const System& s, const std::vector<double>& weights) {
  const std::size_t n = s.columns;
  Normal out{std::vector<double>(n * n, 0.0), std::vector<double>(n, 0.0)};
  for (std::size_t r = 0; r < weights.size(); ++r) {
    const double* row = &s.rows[r * n];
    for (std::size_t i = 0; i < n; ++i) {
      out.right[i] += weights[r] * row[i];
      for (std::size_t j = 0; j < n; ++j) out.matrix[i * n + j] += weights[r] * row[i] * row[j];
    }
  }
  const double count = static_cast<double>(weights.size());
  for (std::size_t i = 0; i < n; ++i) {
    out.matrix[i * n + i] += count * (i > 0 ? kRidge : kSetupRidge);
  }
  return out;
}

/// The solution with x >= 0: of those that least squares give when the others are 0 and none is
/// below 0, the best, which has the largest right.x.
std::vector<double> solve(const System& s, const std::vector<double>& weights) {
  const Normal normal = normalOf(s, weights);
  const std::size_t n = s.columns;
  std::vector<double> best(n, 0.0);
  double most = 0.0;
  for (std::uint32_t set = 1; set < 1u << n; ++set) {
    std::vector<std::size_t> in;
    for (std::size_t i = 0; i < n; ++i) {
      if (set >> i & 1u) in.push_back(i);
    }
    std::vector<double> matrix, right;
    for (std::size_t i : in) {
      right.push_back(normal.right[i]);
      for (std::size_t j : in) matrix.push_back(normal.matrix[i * n + j]);
    }
    const std::vector<double> x = solved(matrix, right);
    double value = 0.0;
    for (std::size_t k = 0; k < in.size(); ++k) value += right[k] * x[k];
    if (value <= most || *std::min_element(x.begin(), x.end()) < 0.0) continue;
    most = value;
    std::fill(best.begin(), best.end(), 0.0);
    for (std::size_t k = 0; k < in.size(); ++k) best[in[k]] = x[k];
  }
  return best;
}

/// Huber's weights of the errors; false if they fit so well that weights would be noise.
bool weigh(const System& s, const std::vector<double>& x, std::vector<double>& weights) {
  std::vector<double> errors(weights.size());
  for (std::size_t r = 0; r < errors.size(); ++r) errors[r] = std::abs(s.error(r, x));
  std::vector<double> sorted = errors;
  std::nth_element(sorted.begin(), sorted.begin() + static_cast<long>(sorted.size() / 2),
                   sorted.end());
  const double limit = kHuber * kNormal * std::max(sorted[sorted.size() / 2], 1e-9);
  bool any = false;
  for (std::size_t r = 0; r < errors.size(); ++r) {
    weights[r] = errors[r] > limit ? limit / errors[r] : 1.0;
    any |= errors[r] > limit;
  }
  return any;
}

}  // namespace

bool isAmount(double value) { return std::isfinite(value) && value >= 0.0; }

double LinearTime::seconds(std::span<const double> amounts) const {
  double sum = 0.0;
  bool empty = true;
  for (std::size_t i = 0; i < std::min(amounts.size(), rates.size()); ++i) {
    sum += rates[i] * amounts[i];
    empty = empty && amounts[i] <= 0.0;
  }
  return empty ? 0.0 : setup + sum;
}

LinearTime fitLinear(std::span<const TimingSample> samples) {
  checkSamples(samples);
  const System system = systemOf(samples);
  std::vector<double> weights(samples.size(), 1.0);
  std::vector<double> x = solve(system, weights);
  for (int round = 0; round < kRounds && weigh(system, x, weights); ++round) {
    x = solve(system, weights);
  }
  LinearTime time;
  time.setup = x[0] / system.scales[0];
  for (std::size_t c = 1; c < system.columns; ++c) {
    time.rates.push_back(system.scales[c] > 0.0 ? x[c] / system.scales[c] : 0.0);
  }
  return time;
}

void TimingModel::set(std::uint32_t device, std::uint32_t kind, LinearTime time) {
  if (!isAmount(time.setup) || !std::all_of(time.rates.begin(), time.rates.end(), isAmount)) {
    fail(ExitCode::kInput,
         "timing model, device {}, kind {}: a parameter is not finite and at least 0", device,
         kind);
  }
  times_.at(std::size_t{device} * kinds_ + kind) = std::move(time);
}

}  // namespace trex::schedule
