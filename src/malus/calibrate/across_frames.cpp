#include "malus/calibrate/internal/across_frames.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {
namespace {

constexpr std::size_t kScatterSuffices = 20;

std::vector<double> channel_of(const FrameSeries& values, std::size_t channel) {
  std::vector<double> series;
  series.reserve(values.size());
  for (const auto& frame : values) series.push_back(frame[channel]);
  return series;
}

// Squared standard error of the mean over frames.
double mean_variance(double scatter, double sampling, std::size_t frames, double kept) {
  const double per_frame = frames >= kScatterSuffices ? scatter : std::max(scatter, sampling);
  return per_frame / (kept * static_cast<double>(frames));
}

double trace_of(const SquareMatrix& matrix) {
  double sum = 0;
  for (int c = 0; c < matrix.n; ++c) sum += matrix(c, c);
  return sum;
}

// The nearest positive semi-definite matrix of the same trace in the Frobenius norm; zero where
// that is not positive. The one number that the projection onto a simplex takes off all eigenvalues
// (Held, Wolfe, Crowder, Math. Programming 6, 1974) is found by bisection.
SquareMatrix nearest_of_same_trace(const SquareMatrix& symmetric) {
  constexpr int kHalvings = 60;
  const double trace = trace_of(symmetric);
  if (!(trace > 0)) return SquareMatrix(symmetric.n);
  const auto less = [&](double taken) {
    SquareMatrix rest = symmetric;
    for (int c = 0; c < rest.n; ++c) rest(c, c) -= taken;
    return nearest_semidefinite(rest);
  };
  double low = 0, high = trace_of(less(0));  // what stays falls from above the trace to nothing
  for (int i = 0; i < kHalvings; ++i) {
    const double middle = 0.5 * (low + high);
    (trace_of(less(middle)) > trace ? low : high) = middle;
  }
  return less(low);
}

bool unchanging(const SquareMatrix& covariance, int channel) {
  for (int c = 0; c < covariance.n; ++c)
    if (covariance(channel, c) != 0) return false;
  return true;
}

// What sampling leaves of variances and covariances is right in the mean, but has negative
// eigenvalues. To cut them off adds to the variances, and takes from the correlations by as much;
// so the sum of the variances, which is what is known best, stays as it is.
void take_sampling_out(ChannelStatistics& statistics, const SquareMatrix& sampling) {
  SquareMatrix remaining = std::move(statistics.covariance);
  for (std::size_t i = 0; i < remaining.values.size(); ++i)
    remaining.values[i] -= sampling.values[i];
  SquareMatrix& real = statistics.covariance;
  real = nearest_of_same_trace(remaining);
  for (int a = 0; a < real.n; ++a)
    for (int b = 0; b < real.n; ++b)  // without what rounding leaves there
      if (unchanging(remaining, a) || unchanging(remaining, b)) real(a, b) = 0;
  statistics.spread.clear();
  for (int c = 0; c < real.n; ++c)
    statistics.spread.push_back(std::sqrt(real(c, c) = std::max(real(c, c), 0.0)));
}

}  // namespace

SquareMatrix frame_covariance(const FrameSeries& values) {
  const std::size_t frames = values.size(), channels = values.front().size();
  SquareMatrix covariance(static_cast<int>(channels));
  if (frames < 2) return covariance;
  std::vector<double> mean(channels, 0.0);
  for (std::size_t c = 0; c < channels; ++c) mean[c] = mean_of(channel_of(values, c));
  for (const auto& frame : values)
    for (std::size_t a = 0; a < channels; ++a)
      for (std::size_t b = 0; b < channels; ++b)
        covariance.values[a * channels + b] +=
            (frame[a] - mean[a]) * (frame[b] - mean[b]) / static_cast<double>(frames - 1);
  return covariance;
}

ChannelStatistics frame_statistics(const FrameSeries& values, const SquareMatrix& sampling,
                                   double kept) {
  MALUS_REQUIRE(!values.empty() && static_cast<int>(values.front().size()) == sampling.n);
  ChannelStatistics out;
  out.covariance = frame_covariance(values);
  for (int c = 0; c < sampling.n; ++c) {
    out.mean.push_back(mean_of(channel_of(values, static_cast<std::size_t>(c))));
    out.standard_error.push_back(
        std::sqrt(mean_variance(out.covariance(c, c), sampling(c, c), values.size(), kept)));
  }
  take_sampling_out(out, sampling);
  out.per_frame = values;
  return out;
}

ChannelStatistics deviation_statistics(const FrameSeries& variances, const SquareMatrix& sampling,
                                       double kept) {
  MALUS_REQUIRE(!variances.empty() && static_cast<int>(variances.front().size()) == sampling.n);
  const int channels = sampling.n;
  const SquareMatrix scatter = frame_covariance(variances);
  ChannelStatistics out;
  out.covariance = SquareMatrix(channels);
  std::vector<double> derivative;  // of the deviation by the variance
  for (int c = 0; c < channels; ++c) {
    const double mean = mean_of(channel_of(variances, static_cast<std::size_t>(c)));
    const double error =
        std::sqrt(mean_variance(scatter(c, c), sampling(c, c), variances.size(), kept));
    const double positive = std::max(mean, 0.0);
    out.mean.push_back(positive);
    const double root = std::sqrt(positive);
    out.standard_error.push_back(0.5 *
                                 std::max(std::sqrt(positive + 2.0 * error) - root,
                                          root - std::sqrt(std::max(positive - 2.0 * error, 0.0))));
    // Var(σ²) = 4 σ² τ² to first order.
    derivative.push_back(positive > 2.0 * error ? 0.5 / std::sqrt(positive) : 0.0);
  }
  for (int a = 0; a < channels; ++a)
    for (int b = 0; b < channels; ++b)
      out.covariance(a, b) = (scatter(a, b) - sampling(a, b)) *
                             derivative[static_cast<std::size_t>(a)] *
                             derivative[static_cast<std::size_t>(b)];
  take_sampling_out(out, SquareMatrix(channels));
  for (std::size_t c = 0; c < out.mean.size(); ++c)
    out.mean[c] = std::sqrt(std::max(out.mean[c] - out.spread[c] * out.spread[c], 0.0));
  out.per_frame = variances;
  for (auto& frame : out.per_frame)
    for (double& value : frame) value = std::sqrt(std::max(value, 0.0));
  return out;
}

}  // namespace malus
