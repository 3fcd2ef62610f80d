#include "model_json.h"

#include "malus/base/error.h"
#include "malus/io/gain_json.h"
#include "malus/noise/level_noise.h"
#include "malus/noise/physics.h"

#include <algorithm>
#include <cmath>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
using Values = std::vector<double>;

Json array_or_null(const Values& values) { return values.empty() ? Json() : Json(values); }

Json matrix_json(const SquareMatrix& matrix) {
  if (matrix.n == 0) return nullptr;
  Json rows = Json::array();
  for (int r = 0; r < matrix.n; ++r) {
    Values row;
    for (int c = 0; c < matrix.n; ++c) row.push_back(matrix(r, c));
    rows.push_back(row);
  }
  return rows;
}

Json statistics_json(const ChannelStatistics& s, const char* unit, bool with_covariance) {
  Json json = {{"mean", array_or_null(s.mean)},
               {"spread", array_or_null(s.spread)},
               {"stderr", array_or_null(s.standard_error)}};
  if (with_covariance) json["covariance"] = matrix_json(s.covariance);
  json["unit"] = unit;
  return json;
}

Json value_json(const Values& value, const Values& standard_error, const char* unit) {
  return {
      {"value", array_or_null(value)}, {"stderr", array_or_null(standard_error)}, {"unit", unit}};
}

// None rather than a list of unknown ones.
Values known_errors(Values errors) {
  const bool any =
      std::any_of(errors.begin(), errors.end(), [](double error) { return std::isfinite(error); });
  return any ? errors : Values{};
}

Json drift_json(const MeasuredRowDrift& measured) {
  if (measured.drift.white()) return nullptr;
  return {{"share",
           {{"value", measured.drift.share}, {"stderr", measured.share_stderr}, {"unit", "1"}}},
          {"length",
           {{"value", measured.drift.length_groups},
            {"stderr", measured.length_stderr},
            {"unit", "row groups"}}}};
}

Json drifts_json(const std::vector<RowDrift>& drifts) {
  if (drifts.empty()) return nullptr;
  Json json = {{"share", Json::array()}, {"length", Json::array()}};
  for (const RowDrift& drift : drifts) {
    json["share"].push_back(drift.share);
    json["length"].push_back(drift.length_groups);
  }
  return json;
}

Json transfer_json(const std::vector<PhotonTransferPoint>& points) {
  Json json = {{"channel", Json::array()},    {"exposure_s", Json::array()},
               {"mean_dn", Json::array()},    {"variance_dn2", Json::array()},
               {"stderr_dn2", Json::array()}, {"used", Json::array()},
               {"why_not", Json::array()}};
  for (const PhotonTransferPoint& point : points) {
    json["channel"].push_back(point.channel);
    json["exposure_s"].push_back(point.exposure_s);
    json["mean_dn"].push_back(point.mean_dn);
    json["variance_dn2"].push_back(point.variance_dn2);
    json["stderr_dn2"].push_back(point.variance_stderr_dn2);
    json["used"].push_back(point.used);
    json["why_not"].push_back(point.why_not);
  }
  return json;
}

Json physics_json(const PhysicsCalibration& p) {
  Json json = gain_json(p.gain);
  json["frames"] = p.bias_frames;
  json["flat_levels"] = p.flat_levels;
  json["K"] = value_json(p.K.mean, p.K.standard_error, "DN/e-");
  json["mu"] = statistics_json(p.mu, "DN", true);
  json["sigma_row"] = statistics_json(p.sigma_row, "DN", true);
  json["row_drift"] = drift_json(p.row_drift);
  json["sigma_tl"] = statistics_json(p.sigma_tl, "DN", false);
  json["lambda"] = statistics_json(p.lambda, "1", false);
  json["read_noise"] = value_json(read_noise_e(p), known_errors(read_noise_stderr_e(p)), "e-");
  json["temporal_sd_dark"] = value_json(p.temporal_sd_dark_dn, p.temporal_sd_dark_stderr_dn, "DN");
  json["K_intercept"] = value_json(p.K_intercept_dn2, p.K_intercept_stderr_dn2, "DN^2");
  json["sigma_column"] = statistics_json(p.sigma_column, "DN", false);
  json["dsnu"] = value_json(p.dsnu_dn, p.dsnu_stderr_dn, "DN");
  json["prnu"] = value_json(p.prnu, p.prnu_stderr, "1");
  json["row_correlation"] = matrix_json(p.row_correlation);
  json["photon_transfer"] = transfer_json(p.transfer);
  json["warnings"] = p.warnings;
  return json;
}

// The laws of a segment by the name they have in the model file.
std::vector<std::pair<const char*, const std::vector<LogLinear>*>> laws_of(
    const JointSegment& segment) {
  return {{"minus_mu", &segment.minus_mu},   {"mu_variance", &segment.mu_variance},
          {"sigma_row", &segment.sigma_row}, {"sigma_row_variance", &segment.sigma_row_variance},
          {"sigma_tl", &segment.sigma_tl},   {"sigma_tl_spread", &segment.sigma_tl_spread}};
}

// {parameter: [per channel]} of one member of the laws.
template <class Member>
Json law_member_json(const JointSegment& segment, Member LogLinear::*member) {
  Json json;
  for (const auto& [name, laws] : laws_of(segment)) {
    Json values = Json::array();
    for (const LogLinear& law : *laws) values.push_back(law.*member);
    json[name] = values;
  }
  return json;
}

Json segment_json(const JointSegment& segment) {
  const LogLinear& K = segment.K_of_gain;
  return {{"log_K_range", {segment.log_K_low(), segment.log_K_high()}},
          {"gain_db_range", {segment.knots_db.front(), segment.knots_db.back()}},
          {"K_of_gain",
           {{"slope", K.slope},
            {"intercept", K.intercept},
            {"residual_sd", K.residual_sd},
            {"unit", "log(DN/e-) per dB"}}},
          {"K_ratio", segment.K_ratio},
          {"slopes", law_member_json(segment, &LogLinear::slope)},
          {"slopes_stderr", law_member_json(segment, &LogLinear::slope_stderr)},
          {"intercepts", law_member_json(segment, &LogLinear::intercept)},
          {"intercepts_stderr", law_member_json(segment, &LogLinear::intercept_stderr)},
          {"residual_sd", law_member_json(segment, &LogLinear::residual_sd)},
          {"residual_weight", law_member_json(segment, &LogLinear::residual_weight)},
          {"residuals", law_member_json(segment, &LogLinear::residual)},
          {"signed_linear", law_member_json(segment, &LogLinear::signed_linear)},
          {"mu_correlation", matrix_json(segment.mu_correlation)},
          {"sigma_row_correlation", matrix_json(segment.sigma_row_correlation)},
          {"row_drift", drifts_json(segment.row_drift)}};
}

Json joint_json(const JointGainModel& joint) {
  double low = joint.segments[0].log_K_low(), high = joint.segments[0].log_K_high();
  Json segments = Json::array(), slopes, intercepts;
  for (const JointSegment& segment : joint.segments) {
    low = std::min(low, segment.log_K_low());
    high = std::max(high, segment.log_K_high());
    segments.push_back(segment_json(segment));
    for (const auto& [name, values] : segments.back()["slopes"].items())
      slopes[name].push_back(values);
    for (const auto& [name, values] : segments.back()["intercepts"].items())
      intercepts[name].push_back(values);
  }
  return {{"log_K_range", {low, high}},
          {"slopes", slopes},
          {"intercepts", intercepts},
          {"segments", segments},
          {"notes", joint.notes}};
}

Json gaussian_json(const GaussianCalibration& g) {
  Json json = gain_json(g.gain);
  json["levels"] = g.levels;
  json["slope"] = value_json(g.slope_dn, g.slope_stderr_dn, "DN");
  json["offset"] = value_json(g.offset_dn2, g.offset_stderr_dn2, "DN^2");
  json["bias"] = value_json(g.bias_dn, {}, "DN");
  json["warnings"] = g.warnings;
  return json;
}

Json nonparametric_json(const NonparametricCalibration& n, double step_dn) {
  Json json = gain_json(n.gain);
  json["frames"] = n.frames;
  Json channels = Json::array();
  for (const NonparametricChannel& channel : n.channels) {
    Values deviation;
    for (std::size_t level = 0; level < channel.level_dn.size(); ++level)
      deviation.push_back(std::sqrt(recorded_variance_dn2(channel, level, step_dn)));
    channels.push_back({{"levels", channel.level_dn},
                        {"samples", channel.samples},
                        {"sd", deviation},
                        {"bins", channel.bin_edges_dn.size() - 1},
                        {"bin_range", {channel.bin_edges_dn.front(), channel.bin_edges_dn.back()}},
                        {"unit", "DN"}});
  }
  json["channels"] = channels;
  json["sigma_row"] = value_json(n.sigma_row_dn, n.sigma_row_stderr_dn, "DN");
  json["row_drift"] = drift_json(n.row_drift);
  json["K"] = value_json(n.K, {}, "DN/e-");
  json["warnings"] = n.warnings;
  return json;
}

Json bank_json(const DarkFrameBank& bank) {
  Json json = gain_json(bank.gain);
  json["frames"] = bank.frames_dn.size();
  json["rows"] = bank.frames_dn[0].rows();
  json["cols"] = bank.frames_dn[0].cols();
  return json;
}

// What at() gives, or nothing where the kind does not know that gain.
template <class At>
auto known_at(const At& at) -> std::vector<decltype(at())> {
  try {
    return {at()};
  } catch (const InputError&) {
    return {};
  }
}

template <class Calibration>
void keep_gain(std::vector<Calibration>& calibrations, const GainSetting& gain) {
  std::erase_if(calibrations, [&](const Calibration& c) { return c.gain != gain; });
}

PhysicsCalibration interpolated_entry(const NoiseModel& model, const GainParameters& p) {
  PhysicsCalibration entry = calibration_of(p);
  entry.temporal_sd_dark_dn = temporal_sd_dark_dn(physics_of(model, p));
  const bool without_K =
      std::any_of(model.physics.begin(), model.physics.end(),
                  [&](const PhysicsCalibration& measured) { return measured.gain == p.gain; });
  entry.warnings = {without_K ? "its K was not measured: all from the joint model"
                              : "not measured at this gain: from the joint model"};
  return entry;
}

}  // namespace

Json model_json(const NoiseModel& model) {
  Json json = {
      {"sensor", model.sensor},
      {"layout", model.layout.name()},
      {"channels", model.layout.channel_names()},
      {"row_group", model.row_group},
      {"row_group_origin", model.row_group_origin},
      {"kinds", model_kind_names(model.kinds())},
      {"origin", model.origin},
      {"saturation_limit", model.saturation_limit > 0 ? Json(model.saturation_limit) : Json()},
      {"warnings", model.warnings},
      {"black", {{"value", model.black_dn}, {"unit", "DN"}}},
      {"white", {{"value", model.white_dn}, {"unit", "DN"}}},
      {"quantization", {{"value", model.quantization_dn}, {"unit", "DN"}}}};
  json["gains"] = Json::array();
  for (const auto& p : model.physics) json["gains"].push_back(physics_json(p));
  json["joint"] = model.joint ? joint_json(*model.joint) : Json();
  for (const auto& g : model.gaussian) json["gaussian"].push_back(gaussian_json(g));
  for (const auto& n : model.nonparametric)
    json["nonparametric"].push_back(nonparametric_json(n, model.quantization_dn));
  for (const auto& bank : model.dark_frames) json["dark_frames"].push_back(bank_json(bank));
  json["defects"] = model.defects.size();
  return json;
}

NoiseModel model_at_gain(const NoiseModel& model, const GainSetting& gain, GainRange range) {
  NoiseModel reduced = model;
  keep_gain(reduced.dark_frames, gain);
  if (model.physics.empty()) {
    if (!model.gaussian.empty()) reduced.gaussian = {model.gaussian_at(gain)};
    if (!model.nonparametric.empty()) reduced.nonparametric = {model.nonparametric_at(gain)};
    if (model.gaussian.empty() && model.nonparametric.empty()) model.dark_frames_at(gain);
    return reduced;
  }
  const GainParameters p = model.parameters_at(gain, range);
  keep_gain(reduced.physics, p.gain);
  if (!p.measured) reduced.physics = {interpolated_entry(model, p)};
  reduced.gaussian = known_at([&] { return model.gaussian_at(gain); });
  reduced.nonparametric = known_at([&] { return model.nonparametric_at(gain); });
  return reduced;
}

}  // namespace malus::app
