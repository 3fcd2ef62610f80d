// What a denoiser needs at a gain, of every kind of model.
#include "malus/base/error.h"
#include "malus/base/wording.h"
#include "malus/noise/column_noise.h"
#include "malus/noise/interpolate_kinds.h"
#include "malus/noise/level_noise.h"
#include "malus/noise/model.h"
#include "malus/noise/profile_parts.h"
#include "malus/noise/rounding.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

namespace malus {
namespace {

NoiseProfile empty_profile(const NoiseModel& model) {
  NoiseProfile profile;
  profile.layout = model.layout;
  profile.row_group = model.row_group;
  profile.step_dn = model.quantization_dn;
  profile.channels.resize(static_cast<std::size_t>(model.layout.channels()));
  return profile;
}

NoiseProfile gaussian_profile(const NoiseModel& model, const GaussianCalibration& calibration,
                              const PhysicsParts& parts) {
  NoiseProfile profile = empty_profile(model);
  if (!parts.quantization) profile.step_dn = 0;
  // The calibrated offset is a recorded frame's, its rounding included.
  const double rounding_dn2 = model.quantization_dn * model.quantization_dn / 12;
  for (std::size_t c = 0; c < profile.channels.size(); ++c) {
    ChannelProfile& channel = profile.channels[c];
    const double slope = calibration.slope_dn[c], electron = slope * slope;
    const double offset_dn2 = (parts.read ? calibration.offset_dn2[c] : rounding_dn2) -
                              (parts.quantization ? 0 : rounding_dn2);
    channel.variance = parts.shot ? VarianceCurve::fitted_line(slope, offset_dn2, electron)
                                  : VarianceCurve::affine(0, std::max(offset_dn2, 0.0));
    if (!calibration.bias_dn.empty()) channel.bias_dn = calibration.bias_dn[c];
    channel.gain_dn_per_e = calibration.slope_dn[c];
  }
  return profile;
}

NoiseProfile nonparametric_profile(const NoiseModel& model,
                                   const NonparametricCalibration& calibration) {
  NoiseProfile profile = empty_profile(model);
  if (!calibration.sigma_row_dn.empty()) profile.row_drift = calibration.row_drift.drift;
  for (std::size_t c = 0; c < profile.channels.size(); ++c) {
    const NonparametricChannel& measured = calibration.channels[c];
    std::vector<double> variance;
    for (std::size_t level = 0; level < measured.pmf.size(); ++level)
      variance.push_back(recorded_variance_dn2(measured, level, model.quantization_dn));
    const double K = gain_of_channel(calibration, c);
    profile.channels[c].variance = VarianceCurve::table(measured.level_dn, variance, K);
    // The distributions hold the dark bias as their mean.
    profile.channels[c].bias_dn = level_moments(measured, 0).mean_dn;
    profile.channels[c].law = NoiseLaw::measured(as_recorded(measured, model.quantization_dn),
                                                 profile.channels[c].bias_dn, K);
    if (!calibration.sigma_row_dn.empty())
      profile.channels[c].sigma_row_dn = calibration.sigma_row_dn[c];
    if (!calibration.K.empty()) profile.channels[c].gain_dn_per_e = calibration.K[c];
  }
  return profile;
}

}  // namespace

NoiseProfile profile_of(const PhysicsNoise& noise) {
  NoiseProfile profile;
  profile.layout = noise.layout;
  profile.row_group = noise.row_group;
  if (noise.parts.row) profile.row_drift = noise.row_drift;
  profile.step_dn = noise.parts.quantization ? noise.quantization_dn : 0.0;
  for (const PhysicsChannel& channel : noise.channels) {
    const double quantization = profile.step_dn * profile.step_dn / 12.0;
    profile.channels.push_back(
        {.variance = VarianceCurve::affine(
             noise.parts.shot ? channel.gain_dn_per_e : 0.0,
             (noise.parts.read ? read_variance_dn2(channel) : 0.0) + quantization),
         .bias_dn = noise.parts.bias ? channel.mu_dn : 0.0,
         .sigma_row_dn = noise.parts.row ? channel.sigma_row_dn : 0.0,
         .gain_dn_per_e = channel.gain_dn_per_e,
         .law = NoiseLaw::physics(channel, noise.parts, profile.step_dn)});
  }
  return profile;
}

namespace {

// The maps tell the sensor's size; a model without them cannot say which frame its defects lie in.
DefectList defects_of(const NoiseModel& model) {
  DefectList list;
  for (const PhysicsCalibration& p : model.physics)
    for (const Image* map : {&p.dark_shading_dn, &p.prnu_map})
      if (!map->empty()) {
        list.rows = map->rows();
        list.cols = map->cols();
      }
  if (list.rows > 0)
    for (const DefectPixel& d : model.defects) list.places.push_back({d.row, d.col});
  return list;
}

// Channels whose dark noise the converter's step hides and nothing tells: their σ_TL is an upper
// limit. It becomes what the dark point says of lit frames, the middle of what is possible. Between
// two gains the limit stays. Returned is how much of that is a guess [DN²]: half of what the codes
// of dark pixels allow at most is taken for sure.
std::vector<double> take_dark_points(const NoiseModel& model, const GainSetting& gain,
                                     PhysicsNoise& noise) {
  std::vector<double> guessed_dn2(noise.channels.size(), 0.0);
  const auto around = model.physics_around(gain);
  if (around.size() != 1) return guessed_dn2;
  const PhysicsCalibration& p = *around.front();
  if (p.dark_point_dn2.empty() || p.temporal_sd_dark_dn.empty() ||
      p.sigma_tl.standard_error.empty())
    return guessed_dn2;
  const double step2 = model.quantization_dn * model.quantization_dn;
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    PhysicsChannel& channel = noise.channels[c];
    const double shown_dn = p.temporal_sd_dark_dn[c], limit_dn2 = read_variance_dn2(channel);
    if (std::isfinite(p.sigma_tl.standard_error[c]) || !(limit_dn2 > 0) ||
        !(shown_dn * shown_dn < kLeastDarkVariance * step2))
      continue;
    const double rows_dn2 = channel.sigma_row_dn * channel.sigma_row_dn,
                 lit_dn2 = p.dark_point_dn2[c] - rows_dn2 - step2 / 12;
    channel.sigma_tl_dn *= std::sqrt(std::clamp(lit_dn2 / limit_dn2, 0.0, 1.0));
    const double sure_dn2 = most_rounded_noise(model.quantization_dn, shown_dn * shown_dn) / 2;
    guessed_dn2[c] = std::max(read_variance_dn2(channel) - sure_dn2, 0.0);
  }
  return guessed_dn2;
}

// The columns' part leaves the pixels' noise; their deviations [DN].
std::vector<double> take_columns(const NoiseModel& model, const GainSetting& gain,
                                 PhysicsNoise& noise) {
  const std::vector<double> shares = column_noise_shares_at(model, gain);
  std::vector<double> sigma_column_dn;
  for (std::size_t c = 0; c < shares.size(); ++c) {
    PhysicsChannel& channel = noise.channels[c];
    sigma_column_dn.push_back(std::sqrt(shares[c] * read_variance_dn2(channel)));
    channel.sigma_tl_dn *= std::sqrt(1 - shares[c]);
  }
  return sigma_column_dn;
}

// Of frames of a camera. Synthesis draws what the model states, and says so (profile_of_parts).
NoiseProfile profile_of_frames(const NoiseModel& model, const GainSetting& gain, GainRange range,
                               ColumnNoise columns) {
  PhysicsNoise noise = model.physics_at(gain, range);
  const std::vector<double> guessed_dn2 = take_dark_points(model, gain, noise);
  std::vector<double> sigma_column_dn(noise.channels.size(), 0.0);
  if (columns == ColumnNoise::kApart) sigma_column_dn = take_columns(model, gain, noise);
  NoiseProfile profile = profile_of(noise);
  for (std::size_t c = 0; c < profile.channels.size(); ++c) {
    profile.channels[c].sigma_column_dn = sigma_column_dn[c];
    profile.channels[c].guessed_dn2 = guessed_dn2[c];
  }
  return profile;
}

NoiseProfile pixel_noise_at(const NoiseModel& model, const GainSetting& gain, GainRange range,
                            const PhysicsParts& parts) {
  if (!model.physics.empty()) {
    PhysicsNoise noise = model.physics_at(gain, range);
    noise.parts = parts;
    return profile_of(noise);
  }
  if (!model.gaussian.empty()) return gaussian_profile(model, model.gaussian_at(gain), parts);
  if (!model.nonparametric.empty()) {
    NoiseProfile profile = nonparametric_profile(model, model.nonparametric_at(gain));
    if (parts.row) return profile;
    profile.row_drift = {};
    for (ChannelProfile& channel : profile.channels) channel.sigma_row_dn = 0;
    return profile;
  }
  throw InputError(model.name(), "holds no model of the pixel noise",
                   "calibrate with " + setting("kinds", model_kind_name(ModelKind::kPhysics)));
}

// What the model knows of a frame beside its noise.
NoiseProfile with_facts(NoiseProfile profile, const NoiseModel& model, const GainSetting& gain) {
  profile.defects = defects_of(model);
  const auto around = model.physics_around(gain);
  profile.dark_was_cut_off =
      std::any_of(around.begin(), around.end(), std::mem_fn(&PhysicsCalibration::dark_was_cut_off));
  return profile;
}

}  // namespace

NoiseProfile NoiseModel::profile_at(const GainSetting& gain, GainRange range,
                                    ColumnNoise columns) const {
  if (physics.empty()) return with_facts(pixel_noise_at(*this, gain, range, {}), *this, gain);
  return with_facts(profile_of_frames(*this, gain, range, columns), *this, gain);
}

NoiseProfile profile_of_parts(const NoiseModel& model, const GainSetting& gain, GainRange range,
                              const PhysicsParts& parts) {
  NoiseProfile profile = with_facts(pixel_noise_at(model, gain, range, parts), model, gain);
  if (!parts.bias) profile.clear_bias();
  return profile;
}

}  // namespace malus
