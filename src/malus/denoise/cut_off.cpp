#include "malus/denoise/cut_off.h"

#include "malus/base/normal_distribution.h"
#include "malus/base/statistics.h"
#include "malus/denoise/internal/channel_levels.h"
#include "malus/noise/clipped_noise.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

constexpr double kLeastShare = 1e-3;  // fewer move no mean by a hundredth of the noise
constexpr double kLeastPixels = 64;
constexpr int kVoidSide = 4;
constexpr double kLeastSteps = 0.5;  // of noise before rounding
constexpr double kFarthest = 5.0;    // deviations above 0 from which noise brings next to none down

bool shows_noise(const ChannelProfile& channel, double step_dn) {
  const double dark_dn2 = channel.variance(0);
  return dark_dn2 > 0 && dark_dn2 - step_dn * step_dn / 12 >= std::pow(kLeastSteps * step_dn, 2);
}

std::size_t place(const Image& dn, int row, int col) {
  return static_cast<std::size_t>(row) * static_cast<std::size_t>(dn.cols()) +
         static_cast<std::size_t>(col);
}

// The mean of a normal deviate of which what lies below 0 is cut off and the mean is then
// `clipped`, in deviations; -1, where a sixth of it shows, for what is less.
double unclipped(double clipped) {
  double mean = clipped;
  for (int i = 0; i < 4; ++i)  // Newton's, from above: convex
    mean = std::max(mean - (mean_above_zero(mean) - clipped) / normal_cdf(mean), -1.0);
  return mean;
}

// All of 0 in the kVoidSide x kVoidSide of a channel with its first at `row`, `col`.
bool all_at_zero(const RawFrame& frame, int row, int col) {
  for (int i = 0; i < kVoidSide; ++i)
    for (int k = 0; k < kVoidSide; ++k) {
      const int r = row + i * frame.layout.rows(), c = col + k * frame.layout.cols();
      if (r < 0 || c < 0 || r >= frame.dn.rows() || c >= frame.dn.cols() || !(frame.dn(r, c) <= 0))
        return false;
    }
  return true;
}

// At the corner of such a square: of half of the pixels at 0, noise makes one in 16,000 so.
bool lies_in_void(const RawFrame& frame, int row, int col) {
  const int up = row - (kVoidSide - 1) * frame.layout.rows(),
            left = col - (kVoidSide - 1) * frame.layout.cols();
  return all_at_zero(frame, row, col) || all_at_zero(frame, row, left) ||
         all_at_zero(frame, up, col) || all_at_zero(frame, up, left);
}

}  // namespace

double CutOff::mean_share() const { return share.empty() ? 0.0 : mean_of(share); }

CutOff measure_cut_off(const RawFrame& frame) {
  CutOff cut_off;
  cut_off.share.assign(static_cast<std::size_t>(frame.layout.channels()), 0.0);
  const auto at_most_zero = [](float dn) { return dn <= 0; };
  if (frame.bits == 0 ||
      std::none_of(frame.dn.values().begin(), frame.dn.values().end(), at_most_zero))
    return cut_off;
  const LightRange light = light_range(frame);
  std::vector<double> at_zero = cut_off.share, pixels = at_zero;
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const auto k = static_cast<std::size_t>(frame.layout.channel_at(r, c));
      if (!light.holds(frame.dn(r, c))) continue;
      if (frame.dn(r, c) < 0) return {cut_off.share, {}};  // signed: nothing ends at 0
      pixels[k] += 1;
      if (!(frame.dn(r, c) <= 0)) continue;
      const bool in_void = lies_in_void(frame, r, c);
      at_zero[k] += !in_void;
      if (!in_void) continue;
      cut_off.is_void.resize(frame.dn.size());
      cut_off.is_void[place(frame.dn, r, c)] = true;
    }
  for (std::size_t k = 0; k < at_zero.size(); ++k)
    if (at_zero[k] >= std::max(kLeastShare * pixels[k], kLeastPixels))
      cut_off.share[k] = at_zero[k] / pixels[k];
  return cut_off;
}

double cut_off_share_of_mean(const RawFrame& frame, const NoiseProfile& of_mean) {
  if (frame.mean_of < 2 || !(frame.layout == of_mean.layout)) return 0;
  std::vector<double> deviation_dn;  // of one frame in the dark
  for (const ChannelProfile& channel : of_mean.channels)
    deviation_dn.push_back(
        std::sqrt(frame.mean_of * (channel.variance(0) + std::pow(channel.sigma_row_dn, 2) +
                                   std::pow(channel.sigma_column_dn, 2))));
  double at_zero = 0;
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const double dn = frame.dn(r, c),
                   sd = deviation_dn[static_cast<std::size_t>(frame.layout.channel_at(r, c))];
      if (dn < 0) return 0;
      if (dn < kFarthest * sd) at_zero += normal_cdf(-unclipped(dn / sd));
    }
  return at_zero / static_cast<double>(frame.dn.size());
}

NoiseProfile with_shown_dark(NoiseProfile profile, const NoiseModel& model,
                             const GainSetting& gain) {
  for (const PhysicsCalibration& p : model.physics) {
    if (!p.dark_was_cut_off() || !(p.gain == gain || model.physics.size() == 1)) continue;
    if (p.temporal_sd_dark_dn.size() != profile.channels.size()) continue;
    for (std::size_t k = 0; k < profile.channels.size(); ++k) {
      ChannelProfile& channel = profile.channels[k];
      const double shown_dn2 = std::pow(p.temporal_sd_dark_dn[k], 2) -
                               std::pow(channel.sigma_row_dn, 2) -
                               std::pow(channel.sigma_column_dn, 2);
      if (!(p.dark_zero_share[k] > kMostUndoneDarkZeros) ||
          !(shown_dn2 > profile.step_dn * profile.step_dn / 12))
        continue;
      channel.variance = VarianceCurve::affine(channel.variance.slope_dn(), shown_dn2);
      channel.law.reset();
    }
  }
  return profile;
}

NoiseProfile before_cut_off(NoiseProfile profile, const RawFrame& frame) {
  if (!profile.dark_was_cut_off) return profile;
  for (std::size_t k = 0; k < profile.channels.size(); ++k)
    if (shows_noise(profile.channels[k], profile.step_dn))
      profile.channels[k] =
          channel_before_clipping(profile.channels[k], {-frame.black_dn[k], profile.step_dn});
  profile.dark_was_cut_off = false;
  return profile;
}

NoiseProfile as_shown(NoiseProfile profile, const RawFrame& frame, const CutOff& cut_off) {
  if (!cut_off.any()) return profile;
  const internal::ChannelLevels levels = internal::channel_levels(frame, profile);
  for (std::size_t k = 0; k < profile.channels.size(); ++k)
    if (cut_off.share[k] > 0 && shows_noise(profile.channels[k], profile.step_dn))
      profile.channels[k] = clipped_channel(
          profile.channels[k], {-double{levels.zero_dn[k]}, profile.step_dn}, levels.highest_dn);
  return profile;
}

bool has_cut_off_law(const NoiseProfile& shown) {
  return std::any_of(
      shown.channels.begin(), shown.channels.end(),
      [](const ChannelProfile& channel) { return channel.law && channel.law->is_clipped(); });
}

void keep_voids(const CutOff& cut_off, Image& dn_above_black) {
  if (cut_off.is_void.empty()) return;
  for (int r = 0; r < dn_above_black.rows(); ++r)
    for (int c = 0; c < dn_above_black.cols(); ++c)
      if (cut_off.is_void[place(dn_above_black, r, c)])
        dn_above_black(r, c) = std::max(dn_above_black(r, c), 0.0f);
}

}  // namespace malus
