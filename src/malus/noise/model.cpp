#include "malus/noise/model.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/noise/interpolate_kinds.h"
#include "malus/noise/parameter_sampler.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

// Gains are typed by people: 1e-6 dB only bridges rounding.
constexpr double kSameGainDb = 1e-6;

std::string unit_name(const GainSetting& gain) { return gain.gain_db ? "dB" : "ISO"; }

template <class Calibration>
std::string gains_text(const std::vector<Calibration>& calibrations) {
  std::vector<std::string> names;
  for (const auto& calibration : calibrations) names.push_back(calibration.gain.text());
  return joined(names);
}

[[noreturn]] void throw_between(const GainSetting& gain, const GainSetting& below,
                                const GainSetting& above) {
  throw InputError(gain.text(),
                   fmt::format("the sensor changes its conversion gain between {} and {}: nothing "
                               "can be interpolated there",
                               below.text(), above.text()),
                   "use one of the two, or a gain on either side");
}

// The calibration at exactly this gain, or null. An unknown gain stands for the only one.
template <class Calibration>
const Calibration* find_gain(const NoiseModel& model, const std::vector<Calibration>& calibrations,
                             const GainSetting& gain) {
  if (calibrations.size() == 1 && (!gain.decibel() || !calibrations[0].gain.decibel()))
    return calibrations.data();
  if (!gain.decibel())
    throw InputError(
        model.name(),
        fmt::format("the gain is not known and the model holds {}", gains_text(calibrations)),
        "give " + setting(calibrations.front().gain.gain_db ? "gain" : "iso"));
  const GainSetting& first = calibrations.front().gain;
  if (gain.gain_db.has_value() != first.gain_db.has_value())
    throw InputError(gain.text(),
                     fmt::format("the noise model names its gains in {}: {}", unit_name(first),
                                 gains_text(calibrations)),
                     fmt::format("give the gain in {}", unit_name(first)));
  for (const auto& calibration : calibrations)
    if (std::abs(*calibration.gain.decibel() - *gain.decibel()) < kSameGainDb) return &calibration;
  return nullptr;
}

// Not measured, or not to be told: none.
std::vector<double> or_zero(std::vector<double> values, int channels) {
  values.resize(static_cast<std::size_t>(channels), 0.0);
  for (double& value : values)
    if (!std::isfinite(value)) value = 0.0;
  return values;
}

// Measured covariance made usable: variances below zero count as zero, correlations are projected.
SquareMatrix usable_covariance(const ChannelStatistics& statistics, int channels) {
  if (statistics.covariance.n == 0)
    return covariance_of(SquareMatrix::identity(channels), or_zero(statistics.spread, channels));
  std::vector<double> deviation(static_cast<std::size_t>(channels), 0.0);
  for (int c = 0; c < channels; ++c)
    deviation[static_cast<std::size_t>(c)] = std::sqrt(std::max(statistics.covariance(c, c), 0.0));
  return covariance_of(nearest_correlation(correlation_of(statistics.covariance)), deviation);
}

GainParameters measured_parameters(const PhysicsCalibration& calibration, int channels) {
  if (calibration.K.mean.empty())
    throw InputError(calibration.gain.text(),
                     "the noise model holds no system gain K there: no usable flat frames",
                     "calibrate with flat frames at this gain");
  GainParameters p;
  p.gain = calibration.gain;
  p.measured = true;
  p.K = calibration.K.mean;
  p.lambda = calibration.lambda.mean;
  p.mu_dn = calibration.mu.mean;
  p.sigma_row_dn = or_zero(calibration.sigma_row.mean, channels);
  p.sigma_tl_dn = calibration.sigma_tl.mean;
  p.sigma_tl_spread_dn = or_zero(calibration.sigma_tl.spread, channels);
  p.mu_covariance = usable_covariance(calibration.mu, channels);
  p.sigma_row_covariance = usable_covariance(calibration.sigma_row, channels);
  p.row_drift = calibration.row_drift.drift;
  return p;
}

// The part of the joint model that a gain lies in, or null.
const JointSegment* segment_around(const NoiseModel& model, const GainSetting& gain) {
  if (!model.joint || !gain.decibel()) return nullptr;
  for (const JointSegment& segment : model.joint->segments)
    if (*gain.decibel() >= segment.knots_db.front() && *gain.decibel() <= segment.knots_db.back())
      return &segment;
  return nullptr;
}

// The gains that the joint model was fitted to are those with K, not all that are held.
const JointSegment& segment_at(const NoiseModel& model, const GainSetting& gain, GainRange range) {
  if (!model.joint)
    throw InputError(gain.text(),
                     fmt::format("not calibrated, and the noise model has no joint model to "
                                 "interpolate with; it holds {}",
                                 gains_text(model.physics)),
                     "use a measured gain or calibrate at two gains or more");
  if (const JointSegment* around = segment_around(model, gain)) return *around;
  const auto& segments = model.joint->segments;
  const auto named = [&](double db) { return GainSetting::at_decibel(db, gain.iso.has_value()); };
  const auto above = std::find_if(segments.begin(), segments.end(), [&](const JointSegment& s) {
    return s.knots_db.front() > *gain.decibel();
  });
  const bool below = above == segments.begin();
  if (!below && above != segments.end())
    throw_between(gain, named((above - 1)->knots_db.back()), named(above->knots_db.front()));
  if (range == GainRange::kCalibratedOnly)
    throw InputError(
        gain.text(),
        fmt::format("outside the calibrated range {} to {}",
                    named(segments.front().knots_db.front()).text(),
                    named(segments.back().knots_db.back()).text()),
        fmt::format("use a gain inside it, or allow extrapolation with {} (in configurations "
                    "extrapolate_gain)",
                    setting("extrapolate_gain", true)));
  return below ? segments.front() : segments.back();
}

template <class Calibration>
void require_kind(const NoiseModel& model, const std::vector<Calibration>& calibrations,
                  ModelKind kind) {
  const std::string_view name = model_kind_name(kind);
  if (calibrations.empty())
    throw InputError(model.name(), fmt::format("holds no {} model", name),
                     fmt::format("calibrate with {}, or use one of: {}", setting("kinds", name),
                                 joined(model_kind_names(model.kinds()))));
}

// The physics part knows a break between the two gains.
bool broken_between(const JointGainModel& joint, const GainSetting& below,
                    const GainSetting& above) {
  for (std::size_t i = 0; i + 1 < joint.segments.size(); ++i)
    if (*below.decibel() <= joint.segments[i].knots_db.back() &&
        *above.decibel() >= joint.segments[i + 1].knots_db.front())
      return true;
  return false;
}

// The measured calibration, or one interpolated between its neighbours.
template <class Calibration>
Calibration calibration_at(const NoiseModel& model, const std::vector<Calibration>& calibrations,
                           ModelKind kind, const GainSetting& gain) {
  require_kind(model, calibrations, kind);
  if (const Calibration* found = find_gain(model, calibrations, gain)) return *found;
  const auto above =
      std::find_if(calibrations.begin(), calibrations.end(),
                   [&](const Calibration& c) { return *c.gain.decibel() > *gain.decibel(); });
  if (above == calibrations.begin() || above == calibrations.end())
    throw InputError(gain.text(),
                     fmt::format("outside the gains of the {} model: {}", model_kind_name(kind),
                                 gains_text(calibrations)),
                     "use a gain inside them");
  const auto below = above - 1;
  for (int i : conversion_gain_breaks(calibrations))
    if (below - calibrations.begin() == i) throw_between(gain, below->gain, above->gain);
  if (model.joint && broken_between(*model.joint, below->gain, above->gain))
    throw_between(gain, below->gain, above->gain);
  return interpolated(*below, *above, gain);
}

}  // namespace

LevelMoments level_moments(const NonparametricChannel& channel, std::size_t level) {
  double total = 0, mean = 0, square = 0;
  for (std::size_t b = 0; b < channel.pmf[level].size(); ++b) {
    const double p = channel.pmf[level][b];
    const double low = channel.bin_edges_dn[b], high = channel.bin_edges_dn[b + 1];
    total += p;
    mean += p * 0.5 * (low + high);
    square += p * (low * low + low * high + high * high) / 3.0;
  }
  mean /= total;
  return {mean, square / total - mean * mean};
}

std::string NoiseModel::name() const { return sensor.empty() ? "noise model" : sensor; }

std::vector<ModelKind> NoiseModel::kinds() const {
  std::vector<ModelKind> held;
  if (!physics.empty()) held.push_back(ModelKind::kPhysics);
  if (!gaussian.empty()) held.push_back(ModelKind::kGaussian);
  if (!nonparametric.empty()) held.push_back(ModelKind::kNonparametric);
  if (!dark_frames.empty()) held.push_back(ModelKind::kDarkFrames);
  return held;
}

GainSetting NoiseModel::setting_of(double gain) const {
  const auto in_iso = [](const auto& calibrations) {
    return !calibrations.empty() && calibrations.front().gain.iso.has_value();
  };
  GainSetting setting;
  if (in_iso(physics) || in_iso(gaussian) || in_iso(nonparametric) || in_iso(dark_frames))
    setting.iso = gain;
  else
    setting.gain_db = gain;
  return setting;
}

GainParameters NoiseModel::parameters_at(const GainSetting& gain, GainRange range) const {
  if (physics.empty())
    throw InputError(
        name(), "holds no physics model, which tells the gain in DN/e-",
        "calibrate with " + setting("kinds", model_kind_name(ModelKind::kPhysics)) + " too");
  const PhysicsCalibration* calibration = find_gain(*this, physics, gain);
  if (calibration && (!calibration->K.mean.empty() || !segment_around(*this, gain)))
    return measured_parameters(*calibration, layout.channels());
  GainParameters p = joint_parameters(segment_at(*this, gain, range), *gain.decibel());
  p.gain = gain;
  if (!are_possible(p))
    throw InputError(gain.text(),
                     "so far from the calibrated gains the laws give no possible noise",
                     "use a gain nearer to them");
  return p;
}

NoiseModel sensor_alone(const NoiseModel& model) {
  NoiseModel sensor;
  sensor.sensor = model.sensor;
  sensor.layout = model.layout;
  sensor.black_dn = model.black_dn;
  sensor.white_dn = model.white_dn;
  sensor.quantization_dn = model.quantization_dn;
  sensor.row_group = model.row_group;
  sensor.row_group_origin = model.row_group_origin;
  sensor.origin = model.origin;
  return sensor;
}

NoiseModel with_row_noise(NoiseModel model, double read_deviations) {
  if (model.physics.empty())
    throw InputError(model.name(), "has no physics part whose row noise could be set",
                     "leave " + setting_name("row_noise") + " out");
  model.joint.reset();
  for (PhysicsCalibration& entry : model.physics) {
    ChannelStatistics rows;
    for (std::size_t k = 0; k < entry.sigma_tl.mean.size(); ++k)
      rows.mean.push_back(read_deviations *
                          tukey_lambda_deviation(entry.sigma_tl.mean[k], entry.lambda.mean[k]));
    rows.spread.assign(rows.mean.size(), 0.0);
    entry.sigma_row = std::move(rows);
    entry.row_drift = {};
  }
  return model;
}

PhysicsNoise physics_of(const NoiseModel& model, const GainParameters& p) {
  PhysicsNoise noise;
  noise.layout = model.layout;
  noise.row_group = model.row_group;
  noise.row_drift = p.row_drift;
  noise.quantization_dn = model.quantization_dn;
  for (std::size_t c = 0; c < p.K.size(); ++c)
    noise.channels.push_back({.gain_dn_per_e = p.K[c],
                              .lambda = p.lambda[c],
                              .mu_dn = p.mu_dn[c],
                              .sigma_tl_dn = std::max(p.sigma_tl_dn[c], 0.0),
                              .sigma_row_dn = std::max(p.sigma_row_dn[c], 0.0)});
  return noise;
}

std::vector<const PhysicsCalibration*> NoiseModel::physics_around(const GainSetting& gain) const {
  if (physics.size() == 1) return {physics.data()};
  if (!gain.decibel()) return {};
  const PhysicsCalibration *below = nullptr, *above = nullptr;
  for (const PhysicsCalibration& p : physics) {
    if (p.K.mean.empty()) continue;
    const double step_db = p.gain.decibel().value_or(0.0) - *gain.decibel();
    if (std::abs(step_db) < kSameGainDb) return {&p};
    if (step_db < 0) below = &p;
    if (step_db > 0 && !above) above = &p;
  }
  std::vector<const PhysicsCalibration*> around;
  for (const PhysicsCalibration* p : {below, above})
    if (p) around.push_back(p);
  return around;
}

PhysicsNoise NoiseModel::physics_at(const GainSetting& gain, GainRange range) const {
  return physics_of(*this, parameters_at(gain, range));
}

GaussianCalibration NoiseModel::gaussian_at(const GainSetting& gain) const {
  return calibration_at(*this, gaussian, ModelKind::kGaussian, gain);
}

NonparametricCalibration NoiseModel::nonparametric_at(const GainSetting& gain) const {
  return calibration_at(*this, nonparametric, ModelKind::kNonparametric, gain);
}

const DarkFrameBank& NoiseModel::dark_frames_at(const GainSetting& gain) const {
  require_kind(*this, dark_frames, ModelKind::kDarkFrames);
  if (const DarkFrameBank* found = find_gain(*this, dark_frames, gain)) return *found;
  throw InputError(gain.text(),
                   fmt::format("the model has dark frames of {} only", gains_text(dark_frames)),
                   "use one of these gains");
}

}  // namespace malus
