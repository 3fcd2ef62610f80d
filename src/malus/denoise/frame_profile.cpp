#include "malus/denoise/frame_profile.h"

#include "malus/base/wording.h"
#include "malus/denoise/column_noise.h"
#include "malus/denoise/cut_off.h"
#include "malus/denoise/internal/channel_levels.h"
#include "malus/denoise/internal/pattern_removal.h"
#include "malus/image/black_levels.h"
#include "malus/noise/fixed_pattern.h"
#include "malus/noise/frame_mean.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kHalf = 0.5;  // of what the model has

// By three errors.
bool clearly_below(double limit, double value, double error) { return value + 3.0 * error < limit; }

// Above black and bias.
struct FrameLight {
  Image dn;
  std::vector<float> saturated_dn;
};

FrameLight light_of(const RawFrame& frame, const NoiseProfile& profile) {
  internal::ChannelLevels levels = internal::channel_levels(frame, profile);
  FrameLight light{frame.dn, std::move(levels.saturated_dn)};
  for (int r = 0; r < light.dn.rows(); ++r)
    for (int c = 0; c < light.dn.cols(); ++c)
      light.dn(r, c) -= levels.zero_dn[static_cast<std::size_t>(frame.layout.channel_at(r, c))];
  return light;
}

bool shows_less_than_half(const RawFrame& frame, const NoiseProfile& profile) {
  const FrameLight light = light_of(frame, profile);
  const auto shown = shown_column_variance(light.dn, profile, light.saturated_dn);
  return shown && clearly_below(kHalf * kHalf, shown->value, shown->error);
}

bool is_shown_missing(const PatternShare& share, bool has_map) {
  const bool told = share.stderr_value > 0;
  return has_map && !share.present() && told &&
         clearly_below(kHalf, share.value, share.stderr_value);
}

// What is left of a map's pixels, of their deviation. Where the frame does not tell, it is there.
double left_of(const PatternShare& share, bool has_map, bool is_taken_out) {
  if (has_map && share.present())
    return share.taken() * (is_taken_out ? std::sqrt(std::max(1 - share.kept, 0.0)) : 1);
  return is_shown_missing(share, has_map) ? 0 : 1;
}

// The same of all of a map's parts. Of columns and smooth shading, which many pixels tell, nothing
// is left where they are taken out: the shading with the pixels' share, which is told by it.
double left_of_parts(const PatternShares& shares, const FixedPattern::Shares& of_variance,
                     bool has_map, bool is_taken_out) {
  const double of_pixels = left_of(shares.pixels, has_map, is_taken_out);
  const double columns = has_map ? shares.columns_taken() : 0,
               smooth = has_map ? shares.pixels_taken() : 0;
  const auto left = [&](double taken) {
    if (!(taken > 0)) return of_pixels;
    return is_taken_out ? 0 : taken;
  };
  const double of_rest = 1 - of_variance.columns - of_variance.smooth;
  return std::sqrt(std::max(of_rest, 0.0) * of_pixels * of_pixels +
                   of_variance.columns * std::pow(left(columns), 2) +
                   of_variance.smooth * std::pow(left(smooth), 2));
}

bool any_pattern(const std::vector<PatternDeviation>& deviations) {
  return std::ranges::any_of(deviations,
                             [](const PatternDeviation& d) { return d.prnu > 0 || d.dsnu_dn > 0; });
}

// How the fixed pattern gets into a profile. is_taken_out: whether denoising will take out what the
// frame shows of the profile's maps. place_is_stated: that the maps lie where the frame does is
// what the user says.
struct PatternUse {
  bool is_taken_out = false, place_is_stated = false;
};

// Returns whether the frame shows none of the maps though its place is stated. By shares of its
// own: preparation asks again, of pixels without defects, weighted by the noise that is added here.
bool count_pattern(NoiseProfile& profile, const RawFrame& frame, const NoiseModel& model,
                   const GainSetting& gain, PatternUse use) {
  std::vector<PatternDeviation> deviations = pattern_deviations_at(model, gain, profile);
  if (!any_pattern(deviations) || !(frame.layout == profile.layout)) return false;
  const auto fits = [&](Image FixedPattern::*map) {
    return profile.pattern && (*profile.pattern.*map).rows() == frame.dn.rows() &&
           (*profile.pattern.*map).cols() == frame.dn.cols();
  };
  const bool dark = fits(&FixedPattern::dark_dn), response = fits(&FixedPattern::response);
  MeasuredPattern shares;
  if (dark || response) {
    const FrameLight light = light_of(frame, profile);
    shares = measure_pattern(light.dn, frame.layout, profile, light.saturated_dn);
  }
  const PatternShare &of_dark = shares.dark.pixels, &of_response = shares.response.pixels;
  // The maps of another place are not the frame's, whose own pattern is there.
  const bool elsewhere =
      use.place_is_stated && !of_dark.present() && !of_response.present() &&
      (is_shown_missing(of_dark, dark) || is_shown_missing(of_response, response));
  if (!elsewhere) {
    const auto parts = [&](FixedPattern::Shares FixedPattern::*map) {
      return profile.pattern ? *profile.pattern.*map : FixedPattern::Shares{};
    };
    const FixedPattern::Shares dark_shares = parts(&FixedPattern::dark_shares),
                               response_shares = parts(&FixedPattern::response_shares);
    for (PatternDeviation& d : deviations) {
      d.prnu *= left_of_parts(shares.response, response_shares, response, use.is_taken_out);
      d.dsnu_dn *= left_of_parts(shares.dark, dark_shares, dark, use.is_taken_out);
    }
  }
  add_pattern_noise(profile, deviations);
  return elsewhere;
}

}  // namespace

NoiseProfile denoising_profile(const RawFrame& frame, const NoiseModel& model,
                               const GainSetting& gain, GainRange range) {
  require_levels(frame);
  const auto profile_with = [&](ColumnNoise columns) {
    return mean_of_frames(with_shown_dark(model.profile_at(gain, range, columns), model, gain),
                          frame.mean_of,
                          frame.bits > 0 ? MeanValues::kRounded : MeanValues::kExact);
  };
  NoiseProfile apart = profile_with(ColumnNoise::kApart);
  if (!apart.has_column_noise() || !(frame.layout == apart.layout) ||
      !shows_less_than_half(frame, apart))
    return apart;
  return profile_with(ColumnNoise::kInPixels);
}

NoiseProfile raw_profile(const RawFrame& frame, const NoiseModel& model, const GainSetting& gain,
                         GainRange range, bool fixed_pattern) {
  NoiseProfile profile = denoising_profile(frame, model, gain, range);
  if (!fixed_pattern) return profile;
  profile.pattern = fixed_pattern_at(model, gain);
  count_pattern(profile, frame, model, gain, {});
  profile.pattern = nullptr;
  return profile;
}

FrameProfile frame_profile(const RawFrame& frame, const NoiseModel& model, const GainSetting& gain,
                           const DenoiseSettings& settings, std::optional<SensorPlace> place,
                           GainRange range) {
  FrameProfile of_frame{denoising_profile(frame, model, gain, range), {}, {}};
  if (settings.fixed_pattern) of_frame.profile.pattern = fixed_pattern_at(model, gain);
  of_frame.left_out = fit_to_sensor(of_frame.profile, frame, place, settings.defects);
  const PatternUse use{true, place.has_value()};
  if (settings.fixed_pattern && count_pattern(of_frame.profile, frame, model, gain, use))
    of_frame.unseen = fmt::format(
        "it shows none of the fixed pattern that the model has at row {}, column {}: is {} right? "
        "The pattern is counted as noise; of a frame that the camera has flat-fielded, leave it "
        "out with {}",
        place->row, place->col, setting("origin"), setting("fixed_pattern", false));
  return of_frame;
}

}  // namespace malus
