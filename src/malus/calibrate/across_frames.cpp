#include "malus/calibrate/internal/across_frames.h"

#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>

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

// Roots of what sampling leaves of the variances, negative ones as 0. That adds to their sum where
// they are all sampling error, and the sum is what is known best: the others are made smaller until
// it is as it was.
std::vector<double> real_deviations(const SquareMatrix& remaining) {
  double sum = 0, positive = 0;
  for (int c = 0; c < remaining.n; ++c) {
    sum += remaining(c, c);
    positive += std::max(remaining(c, c), 0.0);
  }
  const double share = positive > 0 ? std::max(sum, 0.0) / positive : 0.0;
  std::vector<double> deviations;
  for (int c = 0; c < remaining.n; ++c)
    deviations.push_back(std::sqrt(share * std::max(0.0, remaining(c, c))));  // no -0
  return deviations;
}

// The projection only ever adds to variances, so it gives the correlations alone.
void take_sampling_out(ChannelStatistics& statistics, const SquareMatrix& sampling) {
  SquareMatrix& covariance = statistics.covariance;
  for (std::size_t i = 0; i < covariance.values.size(); ++i)
    covariance.values[i] -= sampling.values[i];
  statistics.spread = real_deviations(covariance);
  covariance = covariance_of(correlation_of(nearest_semidefinite(covariance)), statistics.spread);
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
