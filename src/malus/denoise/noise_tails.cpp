#include "malus/denoise/internal/noise_tails.h"

#include "malus/base/normal_distribution.h"
#include "malus/base/normal_nodes.h"
#include "malus/denoise/internal/sampled_pixels.h"

#include <algorithm>
#include <cmath>

namespace malus::internal {
namespace {

constexpr std::size_t kSamples = 4096;

// Share of pixels of this signal whose read noise and shot noise together lie beyond a threshold.
double share_beyond(const ChannelProfile& channel, double signal_dn, double threshold) {
  const double normal = 2 * normal_cdf(-threshold);
  const double variance = std::max(channel.variance(signal_dn), 0.0);
  if (!channel.law || !(variance > 0)) return normal;
  const double noise = std::sqrt(variance),
               shot = std::sqrt(std::max(variance - channel.variance(0), 0.0));
  double read = 0;
  for (const NormalNode& node : kNormalNodes)
    read += node.weight *
            channel.law->read_tail(std::max(threshold * noise - node.at * shot, 1e-3 * noise));
  return std::max(normal, read);
}

}  // namespace

std::vector<double> expected_beyond(const PreparedFrame& frame, const NoiseProfile& profile,
                                    std::span<const double> thresholds) {
  std::vector<double> expected(thresholds.size());
  double sampled = 0;
  for_each_sampled(frame.dn, kSamples, [&](int row, int col) {
    const auto& channel =
        profile.channels[static_cast<std::size_t>(frame.layout.channel_at(row, col))];
    for (std::size_t t = 0; t < thresholds.size(); ++t)
      expected[t] += share_beyond(channel, frame.dn(row, col), thresholds[t]);
    ++sampled;
  });
  for (double& count : expected) count *= static_cast<double>(frame.dn.size()) / sampled;
  return expected;
}

}  // namespace malus::internal
