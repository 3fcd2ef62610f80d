#include "malus/denoise/noise_check.h"

#include "malus/base/wording.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/prepared_frame.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kTileCells = 32;  // per side: whole blocks of estimate_profile
constexpr std::int64_t kSampledPixels = 1 << 20;
constexpr double kBelowDeviations = 6.0;
// Noise of fewer steps may be rounded away: what is left in the middle of a step has less than
// kFarBelow of noise and rounding together.
constexpr double kFewSteps = 0.3;
// docs/noise-estimate.md says what they were measured on.
constexpr double kFarBelow = 0.7, kFarAbove = 1.6, kMostTexture = 0.1, kMostBelowDark = 0.1;

// Texture shares of photographs and grain, and of print, which shows at least this share of its
// noise (docs/denoising-experiments.md, "Pixels that are alike").
constexpr double kSceneTexture = 0.5, kPrintTexture = 0.7, kPrintShows = 0.75;

// Tiles spread over the frame, side by side, in the layout's phase; small frames as they are.
// Saturated pixels are at range_dn; what was not a number, or shows no noise, is none here.
Image sample_of(const PreparedFrame& frame) {
  const auto value = [&](int row, int col) {
    const auto place = static_cast<std::size_t>(row) * static_cast<std::size_t>(frame.dn.cols()) +
                       static_cast<std::size_t>(col);
    if ((!frame.is_noiseless.empty() && frame.is_noiseless[place]) ||
        std::binary_search(frame.nonfinite.begin(), frame.nonfinite.end(),
                           NonfinitePixel{row, col, 0.0f}, precedes))
      return std::numeric_limits<float>::quiet_NaN();
    return frame.saturated(row, col) ? static_cast<float>(frame.range_dn) : frame.dn(row, col);
  };
  const int tile_rows = kTileCells * frame.layout.rows(),
            tile_cols = kTileCells * frame.layout.cols();
  const int down = frame.dn.rows() / tile_rows, across = frame.dn.cols() / tile_cols;
  const std::int64_t tiles = std::int64_t{down} * across,
                     wanted = kSampledPixels / (std::int64_t{tile_rows} * tile_cols);
  if (tiles <= wanted) {
    Image whole(frame.dn.rows(), frame.dn.cols());
    for (int r = 0; r < whole.rows(); ++r)
      for (int c = 0; c < whole.cols(); ++c) whole(r, c) = value(r, c);
    return whole;
  }
  const auto side = static_cast<int>(std::sqrt(static_cast<double>(wanted)));
  const double step = static_cast<double>(tiles) / (side * side);
  Image sample(side * tile_rows, side * tile_cols);
  for (int i = 0; i < side * side; ++i) {
    // Uneven distances: no column of tiles is chosen again and again.
    const double within = std::fmod(i * 0.618, 1.0);
    const auto tile = static_cast<int>((i + within) * step);
    const int row = tile / across * tile_rows, col = tile % across * tile_cols;
    for (int r = 0; r < tile_rows; ++r)
      for (int c = 0; c < tile_cols; ++c)
        sample(i / side * tile_rows + r, i % side * tile_cols + c) = value(row + r, col + c);
  }
  return sample;
}

struct ChannelSums {
  double signal = 0, pixels = 0, below = 0;
  double mean() const { return signal / std::max(pixels, 1.0); }
};

std::vector<ChannelSums> sums_of(const RawFrame& sample, const NoiseProfile& profile) {
  std::vector<ChannelSums> sums(profile.channels.size());
  std::vector<double> lowest;
  for (const ChannelProfile& channel : profile.channels)
    lowest.push_back(-kBelowDeviations *
                     std::sqrt(std::max(channel.variance(0), 0.0) +
                               channel.sigma_row_dn * channel.sigma_row_dn +
                               channel.sigma_column_dn * channel.sigma_column_dn));
  for (int r = 0; r < sample.dn.rows(); ++r)
    for (int c = 0; c < sample.dn.cols(); ++c) {
      const auto k = static_cast<std::size_t>(sample.layout.channel_at(r, c));
      const double value = sample.dn(r, c);
      if (!(value < sample.white_dn)) continue;
      sums[k].signal += value;
      sums[k].pixels += 1;
      sums[k].below += value < lowest[k];
    }
  return sums;
}

// A masked or black frame, and one that is cut off at its least value, show no noise, whatever the
// camera has. Channels have dark levels of their own.
bool mostly_least_value(const RawFrame& sample) {
  std::vector<float> least(static_cast<std::size_t>(sample.layout.channels()),
                           std::numeric_limits<float>::infinity());
  std::vector<std::int64_t> at_least(least.size(), 0);
  std::int64_t all = 0;
  for (int r = 0; r < sample.dn.rows(); ++r)
    for (int c = 0; c < sample.dn.cols(); ++c) {
      const float value = sample.dn(r, c);
      if (!std::isfinite(value)) continue;
      ++all;
      const auto k = static_cast<std::size_t>(sample.layout.channel_at(r, c));
      if (value < least[k]) at_least[k] = 0;
      least[k] = std::min(least[k], value);
      at_least[k] += value == least[k];
    }
  return 2 * std::accumulate(at_least.begin(), at_least.end(), std::int64_t{0}) >= all;
}

// The noise that the sample shows at its channels' means; false where it cannot tell.
bool take_noise_of(const RawFrame& sample, const std::vector<ChannelSums>& sums,
                   TextureSearch search, NoiseCheck& check) {
  const Estimate<PictureNoise> own = estimate_profile(sample, search);
  // One channel cannot tell.
  check.texture_share = own && sums.size() > 1 ? own->texture_share : 1;
  const bool tells = own || (!mostly_least_value(sample) && is_without_noise(sample));
  check.frame_sd_dn = tells ? 0.0 : std::numeric_limits<double>::quiet_NaN();
  for (std::size_t k = 0; own && k < sums.size(); ++k)
    check.frame_sd_dn += std::sqrt(own->profile.channels[k].variance(sums[k].mean())) /
                         static_cast<double>(sums.size());
  return tells;
}

}  // namespace

std::optional<NoiseCheck> check_noise(const PreparedFrame& frame, const NoiseProfile& profile) {
  if (profile.estimated_from_picture) return std::nullopt;
  RawFrame sample;
  sample.layout = frame.layout;
  sample.dn = sample_of(frame);
  sample.black_dn.assign(profile.channels.size(), 0.0);
  sample.white_dn = frame.range_dn;
  sample.black_known = sample.white_known = true;
  if (!(sample.white_dn > 0)) return std::nullopt;
  NoiseCheck check;
  double pixels = 0, before_rounding = -profile.step_dn * profile.step_dn / 12;
  const std::vector<ChannelSums> sums = sums_of(sample, profile);
  const auto channels = static_cast<double>(sums.size());
  for (std::size_t k = 0; k < sums.size(); ++k) {
    const double signal = sums[k].mean();
    check.profile_sd_dn += std::sqrt(profile.channels[k].variance(signal)) / channels;
    before_rounding += profile.channels[k].variance(signal) / channels;
    check.below_dark_share += sums[k].below;
    pixels += sums[k].pixels;
  }
  check.below_dark_share /= std::max(pixels, 1.0);
  if (profile.step_dn > 0)
    check.sd_in_steps = std::sqrt(std::max(before_rounding, 0.0)) / profile.step_dn;
  const bool shown = take_noise_of(sample, sums, TextureSearch::kQuick, check);
  if (shown && check.frame_sd_dn > kFarAbove * check.profile_sd_dn)
    take_noise_of(sample, sums, TextureSearch::kWhole, check);
  // A frame cut off at 0 shows no noise, and that it lies below the dark level all the same.
  if (!shown && check.below_dark_share <= kMostBelowDark) return std::nullopt;
  return check;
}

double sure_noise_share(const std::optional<NoiseCheck>& check) {
  if (!check || !std::isfinite(check->frame_sd_dn) || !(check->profile_sd_dn > 0)) return 1;
  const double like_print = std::clamp(
      (check->texture_share - kSceneTexture) / (kPrintTexture - kSceneTexture), 0.0, 1.0);
  const double least = check->profile_sd_dn * (1 - (1 - kPrintShows) * like_print);
  return std::min(std::pow(check->frame_sd_dn / least, 2), 1.0);
}

std::string noise_complaint(const NoiseCheck& check) {
  const auto check_settings = [] {
    return fmt::format("check {}, {} and {}", setting("gain"), setting("black"), setting("model"));
  };
  const double ratio = check.frame_sd_dn / check.profile_sd_dn;
  const std::string numbers =
      check.frame_sd_dn == 0
          ? fmt::format("it shows no noise at all, the model's is {:.3g} DN at the mean signal",
                        check.profile_sd_dn)
          : fmt::format("its noise is {:.3g} DN at the mean signal, that of the model {:.3g} DN",
                        check.frame_sd_dn, check.profile_sd_dn);
  if (check.below_dark_share > kMostBelowDark)
    return fmt::format(
        "{:.3g} % of its pixels lie below the model's dark level by more than {:g} deviations of "
        "the dark noise: another camera, black level or gain? {}",
        100 * check.below_dark_share, kBelowDeviations, check_settings());
  if (ratio < kFarBelow && check.sd_in_steps > kFewSteps)
    return numbers +
           fmt::format(
               ": another gain or camera, a frame that was smoothed before, or a mean of "
               "several ({})? ",
               setting("mean_of")) +
           check_settings();
  if (ratio > kFarAbove && check.texture_share < kMostTexture)
    return numbers + ", and little of it is texture: another gain or camera? " + check_settings();
  return {};
}

}  // namespace malus
