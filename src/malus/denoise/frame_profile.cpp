#include "malus/denoise/frame_profile.h"

#include "malus/denoise/column_noise.h"
#include "malus/denoise/cut_off.h"
#include "malus/denoise/internal/channel_levels.h"
#include "malus/image/black_levels.h"
#include "malus/noise/fixed_pattern.h"

namespace malus {
namespace {

// Clearly so: by three errors.
bool shows_less_than_half(const RawFrame& frame, const NoiseProfile& profile) {
  constexpr double kHalf = 0.5, kErrors = 3.0;
  const internal::ChannelLevels levels = internal::channel_levels(frame, profile);
  Image above_dn = frame.dn;
  for (int r = 0; r < above_dn.rows(); ++r)
    for (int c = 0; c < above_dn.cols(); ++c)
      above_dn(r, c) -= levels.zero_dn[static_cast<std::size_t>(frame.layout.channel_at(r, c))];
  const auto shown = shown_column_variance(above_dn, profile, levels.saturated_dn);
  return shown && shown->value + kErrors * shown->error < kHalf * kHalf;
}

}  // namespace

NoiseProfile denoising_profile(const RawFrame& frame, const NoiseModel& model,
                               const GainSetting& gain, GainRange range) {
  require_levels(frame);
  NoiseProfile apart =
      with_shown_dark(model.profile_at(gain, range, ColumnNoise::kApart), model, gain);
  if (!apart.has_column_noise() || !(frame.layout == apart.layout) ||
      !shows_less_than_half(frame, apart))
    return apart;
  return with_shown_dark(model.profile_at(gain, range), model, gain);
}

FrameProfile frame_profile(const RawFrame& frame, const NoiseModel& model, const GainSetting& gain,
                           const DenoiseSettings& settings, std::optional<SensorPlace> place,
                           GainRange range) {
  FrameProfile of_frame{denoising_profile(frame, model, gain, range), {}};
  if (settings.fixed_pattern) of_frame.profile.pattern = fixed_pattern_at(model, gain);
  of_frame.left_out = fit_to_sensor(of_frame.profile, frame, place, settings.defects);
  return of_frame;
}

}  // namespace malus
