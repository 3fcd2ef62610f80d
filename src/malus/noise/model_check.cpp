// Contradictions inside a noise model: what a file may claim and no sensor can be.
#include "malus/noise/model.h"
#include "malus/noise/parameter_sampler.h"
#include "malus/noise/physics.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

// The first problem found; later checks do nothing.
class Findings {
 public:
  void require(bool holds, const std::string& where, const std::string& problem) {
    if (!holds && text_.empty()) text_ = where + " " + problem;
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

enum class Need { kRequired, kOptional };

// In DN, DN/e- or DN^2 of a sensor; demosaicking takes pixels of as much for no light either.
constexpr double kBeyondSensors = 1e15;

bool all_finite(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return std::isfinite(v); });
}

void check_sized(Findings& findings, const std::vector<double>& values, std::size_t size,
                 const std::string& where, Need need = Need::kOptional) {
  if (values.empty() && need == Need::kOptional) return;
  findings.require(values.size() == size, where,
                   fmt::format("has {} values where {} are needed", values.size(), size));
}

void check_values(Findings& findings, const std::vector<double>& values, std::size_t size,
                  const std::string& where, Need need = Need::kOptional) {
  check_sized(findings, values, size, where, need);
  findings.require(all_finite(values), where, "holds a value that is not finite");
  for (const double value : values)
    findings.require(std::abs(value) < kBeyondSensors, where,
                     fmt::format("is {:g}, which no sensor has", value));
}

// What is squared, drawn or plotted as a deviation; NaN where it was not told.
void check_deviations(Findings& findings, const std::vector<double>& values, std::size_t size,
                      const std::string& where) {
  check_sized(findings, values, size, where);
  for (const double value : values)
    findings.require(!(value < 0 || value >= kBeyondSensors), where,
                     fmt::format("is {:g}: no deviation of a sensor", value));
}

void check_matrix(Findings& findings, const SquareMatrix& m, int size, const std::string& where) {
  if (m.n == 0) return;
  findings.require(m.n == size && m.values.size() == static_cast<std::size_t>(size) *
                                                         static_cast<std::size_t>(size),
                   where, fmt::format("is {0} x {0} where {1} x {1} is needed", m.n, size));
  if (!findings.text().empty()) return;
  findings.require(all_finite(m.values), where, "holds a value that is not finite");
  // Against the largest entry: what a projection leaves of a zero is rounding.
  double largest = 0;
  for (const double value : m.values) largest = std::max(largest, std::abs(value));
  for (int r = 0; r < m.n; ++r)
    for (int c = 0; c < r; ++c)
      findings.require(std::abs(m(r, c) - m(c, r)) <= 1e-9 * largest, where, "is not symmetric");
}

constexpr double kRounding = 1e-6;  // that a projection leaves
constexpr double kCorrelated = 1 + kRounding;

// Covariances, and correlations, whose variances are 1.
void check_shared(Findings& findings, const SquareMatrix& m, int size, const std::string& where,
                  double most_variance = kBeyondSensors) {
  check_matrix(findings, m, size, where);
  if (m.n == 0 || !findings.text().empty()) return;
  double largest = 0;
  for (int c = 0; c < m.n; ++c) {
    findings.require(m(c, c) >= 0 && m(c, c) <= most_variance, where,
                     fmt::format("has a variance of {:g}", m(c, c)));
    largest = std::max(largest, m(c, c));
  }
  for (int r = 0; r < m.n; ++r)
    for (int c = 0; c < r; ++c)
      findings.require(!(std::abs(m(r, c)) > std::sqrt(m(r, r) * m(c, c)) + kRounding * largest),
                       where, "lets two channels share more than they vary");
}

void check_statistics(Findings& findings, const ChannelStatistics& s, int channels,
                      const std::string& where, Need need) {
  const auto n = static_cast<std::size_t>(channels);
  check_values(findings, s.mean, n, where, need);
  check_sized(findings, s.standard_error, n, where + " standard error");
  check_deviations(findings, s.spread, n, where + " spread");
  check_shared(findings, s.covariance, channels, where + " covariance");
  for (const auto& frame : s.per_frame)
    check_sized(findings, frame, n, where + " per frame", Need::kRequired);
}

void check_drift(Findings& findings, const MeasuredRowDrift& measured, const std::string& at) {
  const std::string problem = contradiction_in(measured.drift);
  findings.require(problem.empty(), at + "row drift", problem);
  findings.require(measured.share_stderr >= 0 && measured.length_stderr >= 0, at + "row drift",
                   "has a standard error that is none");
}

void check_map(Findings& findings, const Image& map, const SensorLayout& layout,
               const std::string& where) {
  findings.require(map.empty() || (map.rows() >= layout.rows() && map.cols() >= layout.cols()),
                   where, "is smaller than the layout's cell");
  findings.require(std::all_of(map.values().begin(), map.values().end(),
                               [](float value) { return std::isfinite(value); }),
                   where, "holds a value that is not finite");
}

void check_transfer(Findings& findings, const PhotonTransferPoint& point, int channels,
                    const std::string& where) {
  findings.require(point.channel >= 0 && point.channel < channels, where,
                   "names a channel that the layout lacks");
  // An exposure may be unknown (NaN), and so may a standard error.
  findings.require(std::isfinite(point.mean_dn) && std::isfinite(point.variance_dn2) &&
                       std::isfinite(point.dark_variance_dn2) && !std::isinf(point.exposure_s),
                   where, "holds a value that is not finite");
}

void check_lambda(Findings& findings, const std::vector<double>& values, const std::string& where) {
  for (double lambda : values)
    findings.require(lambda > kNoVarianceLambda && lambda <= kHighestLambda, where,
                     fmt::format("is {}, not above {} (the read noise would have no variance) and "
                                 "at most {}",
                                 lambda, kNoVarianceLambda, kHighestLambda));
}

void check_physics(Findings& findings, const PhysicsCalibration& p, const SensorLayout& layout) {
  const std::string at = gain_prefix(p.gain);
  const int channels = layout.channels();
  const auto n = static_cast<std::size_t>(channels);
  check_statistics(findings, p.K, channels, at + "K", Need::kOptional);
  check_statistics(findings, p.mu, channels, at + "mu", Need::kRequired);
  check_statistics(findings, p.sigma_tl, channels, at + "sigma_tl", Need::kRequired);
  check_statistics(findings, p.lambda, channels, at + "lambda", Need::kRequired);
  check_statistics(findings, p.sigma_row, channels, at + "sigma_row", Need::kOptional);
  check_statistics(findings, p.sigma_column, channels, at + "sigma_column", Need::kOptional);
  for (double K : p.K.mean)
    findings.require(K > 0, at + "K", fmt::format("is {}, not positive", K));
  check_lambda(findings, p.lambda.mean, at + "lambda");
  check_deviations(findings, p.sigma_tl.mean, n, at + "sigma_tl");
  check_deviations(findings, p.sigma_row.mean, n, at + "sigma_row");
  check_deviations(findings, p.sigma_column.mean, n, at + "sigma_column");
  findings.require(p.bias_frames >= 0 && p.flat_levels >= 0, at + "number of frames or levels",
                   "is below 0");
  check_sized(findings, p.K_intercept_dn2, n, at + "K_intercept");
  check_sized(findings, p.K_intercept_stderr_dn2, n, at + "K_intercept standard error");
  check_sized(findings, p.line_intercept_dn2, n, at + "line_intercept");
  check_deviations(findings, p.temporal_sd_dark_dn, n, at + "temporal_sd_dark");
  check_sized(findings, p.temporal_sd_dark_stderr_dn, n, at + "temporal_sd_dark standard error");
  check_sized(findings, p.dark_point_dn2, n, at + "dark_point_dn2");
  check_sized(findings, p.dark_point_stderr_dn2, n, at + "dark_point_stderr_dn2");
  check_sized(findings, p.dark_zero_share, n, at + "dark_zero_share");
  check_deviations(findings, p.dsnu_dn, n, at + "dsnu");
  check_sized(findings, p.dsnu_stderr_dn, n, at + "dsnu standard error");
  check_deviations(findings, p.prnu, n, at + "prnu");
  check_sized(findings, p.prnu_stderr, n, at + "prnu standard error");
  check_values(findings, p.residual_cell_dn, n, at + "residual cells");
  for (const double cell : p.residual_cell_dn)
    findings.require(cell > 0, at + "residual cells", fmt::format("are {} DN wide", cell));
  findings.require(p.residual_counts.size() == p.residual_cell_dn.size(), at + "residual counts",
                   "do not fit their cells");
  for (const auto& counts : p.residual_counts)
    findings.require(std::all_of(counts.begin(), counts.end(),
                                 [](double count) { return count >= 0 && std::isfinite(count); }),
                     at + "residual counts", "hold a value that counts nothing");
  check_shared(findings, p.row_correlation, channels, at + "row_correlation", kCorrelated);
  check_drift(findings, p.row_drift, at);
  for (const auto& point : p.transfer)
    check_transfer(findings, point, channels, at + "photon transfer");
  check_map(findings, p.dark_shading_dn, layout, at + "dark_shading");
  check_map(findings, p.prnu_map, layout, at + "prnu_map");
}

void check_laws(Findings& findings, const std::vector<LogLinear>& laws, std::size_t count,
                std::size_t knots, const std::string& where) {
  findings.require(laws.size() == count, where,
                   fmt::format("has {} laws where {} are needed", laws.size(), count));
  for (const LogLinear& law : laws) {
    findings.require(std::isfinite(law.slope) && std::isfinite(law.intercept) &&
                         std::isfinite(law.residual_weight),
                     where, "holds a value that is not finite");
    check_values(findings, law.residual, knots, where + " residual", Need::kRequired);
  }
}

// What the laws give at their knots; between them their exponents are linear. Contract: sizes fit.
void check_knots(Findings& findings, const JointSegment& s) {
  for (const double gain_db : s.knots_db)
    findings.require(are_possible(joint_parameters(s, gain_db)),
                     fmt::format("joint model: the laws at {:g} dB", gain_db),
                     "give a value that is not finite, or a K that is not positive");
}

void check_segment(Findings& findings, const JointSegment& s, int channels) {
  const auto n = static_cast<std::size_t>(channels);
  const std::size_t knots = s.knots_db.size();
  findings.require(knots > 0 && all_finite(s.knots_db) &&
                       std::adjacent_find(s.knots_db.begin(), s.knots_db.end(),
                                          std::greater_equal<>()) == s.knots_db.end(),
                   "joint model: gains", "are not rising");
  check_values(findings, s.knots_log_K, knots, "joint model: log K", Need::kRequired);
  for (const double log_K : s.knots_log_K)
    findings.require(std::abs(log_K) < std::log(kBeyondSensors), "joint model: log K",
                     fmt::format("is {:g}, which no sensor has", log_K));
  check_values(findings, s.K_ratio, n, "joint model: K_ratio", Need::kRequired);
  for (const double ratio : s.K_ratio)
    findings.require(ratio > 0, "joint model: K_ratio", fmt::format("is {}, not positive", ratio));
  check_laws(findings, {s.K_of_gain}, 1, knots, "joint model: K_of_gain");
  check_laws(findings, s.minus_mu, n, knots, "joint model: minus_mu");
  check_laws(findings, s.mu_variance, n, knots, "joint model: mu_variance");
  check_laws(findings, s.sigma_row, n, knots, "joint model: sigma_row");
  check_laws(findings, s.sigma_row_variance, n, knots, "joint model: sigma_row_variance");
  check_laws(findings, s.sigma_tl, n, knots, "joint model: sigma_tl");
  check_laws(findings, s.sigma_tl_spread, n, knots, "joint model: sigma_tl_spread");
  findings.require(s.mu_correlation.n == channels && s.sigma_row_correlation.n == channels,
                   "joint model: a correlation matrix", "is missing");
  check_shared(findings, s.mu_correlation, channels, "joint model: mu_correlation", kCorrelated);
  check_shared(findings, s.sigma_row_correlation, channels, "joint model: sigma_row_correlation",
               kCorrelated);
  findings.require(s.lambda.size() == knots, "joint model: lambda", "does not fit its gains");
  for (const auto& knot : s.lambda) {
    check_values(findings, knot, n, "joint model: lambda", Need::kRequired);
    check_lambda(findings, knot, "joint model: lambda");
  }
  findings.require(s.row_drift.empty() || s.row_drift.size() == knots, "joint model: row drift",
                   "does not fit its gains");
  for (const RowDrift& drift : s.row_drift)
    check_drift(findings, {.drift = drift}, "joint model: ");
  if (findings.text().empty()) check_knots(findings, s);
}

void check_joint(Findings& findings, const NoiseModel& m) {
  if (!m.joint) return;
  const auto& segments = m.joint->segments;
  findings.require(!m.physics.empty() && !segments.empty(), "joint model", "has no gains");
  for (const JointSegment& segment : segments)
    check_segment(findings, segment, m.layout.channels());
  if (!findings.text().empty()) return;
  for (std::size_t i = 1; i < segments.size(); ++i)
    findings.require(segments[i - 1].knots_db.back() < segments[i].knots_db.front(),
                     "joint model: segments", "are not rising");
}

void check_gaussian(Findings& findings, const GaussianCalibration& g, std::size_t channels) {
  const std::string at = gain_prefix(g.gain) + "Gaussian ";
  check_values(findings, g.slope_dn, channels, at + "slope", Need::kRequired);
  for (const double slope : g.slope_dn)
    findings.require(slope >= 0, at + "slope",
                     fmt::format("is {}: noise would fall with the light", slope));
  check_values(findings, g.offset_dn2, channels, at + "offset", Need::kRequired);
  check_sized(findings, g.slope_stderr_dn, channels, at + "slope standard error");
  check_sized(findings, g.offset_stderr_dn2, channels, at + "offset standard error");
  check_values(findings, g.bias_dn, channels, at + "bias");
}

bool rising(const std::vector<double>& values) {
  return std::adjacent_find(values.begin(), values.end(), std::greater_equal<>()) == values.end();
}

void check_channel(Findings& findings, const NonparametricChannel& c, const std::string& at) {
  constexpr double kSumTolerance = 1e-6;
  findings.require(!c.level_dn.empty() && all_finite(c.level_dn) && rising(c.level_dn),
                   at + "levels", "are missing or not rising");
  findings.require(
      c.bin_edges_dn.size() >= 2 && all_finite(c.bin_edges_dn) && rising(c.bin_edges_dn),
      at + "bin edges", "are missing or not rising");
  findings.require(c.pmf.size() == c.level_dn.size(), at + "pmf", "does not fit its levels");
  findings.require(c.samples.empty() || c.samples.size() == c.level_dn.size(), at + "samples",
                   "do not fit their levels");
  for (const auto& pmf : c.pmf) {
    double sum = 0;
    for (double p : pmf) {
      findings.require(p >= 0 && std::isfinite(p), at + "pmf", "holds an impossible probability");
      sum += p;
    }
    findings.require(pmf.size() + 1 == c.bin_edges_dn.size(), at + "pmf", "does not fit its bins");
    findings.require(std::abs(sum - 1.0) < kSumTolerance, at + "pmf",
                     fmt::format("adds to {}, not 1", sum));
  }
}

void check_nonparametric(Findings& findings, const NonparametricCalibration& n,
                         std::size_t channels) {
  const std::string at = gain_prefix(n.gain) + "non-parametric ";
  findings.require(n.channels.size() == channels, at + "channels", "do not fit the layout");
  for (const auto& channel : n.channels) check_channel(findings, channel, at);
  check_values(findings, n.sigma_row_dn, channels, at + "sigma_row");
  check_deviations(findings, n.sigma_row_dn, channels, at + "sigma_row");
  check_sized(findings, n.sigma_row_stderr_dn, channels, at + "sigma_row standard error");
  check_drift(findings, n.row_drift, at);
  check_values(findings, n.K, channels, at + "K");
}

void check_bank(Findings& findings, const DarkFrameBank& bank, const SensorLayout& layout) {
  findings.require(!bank.frames_dn.empty(), "dark frames", "are missing");
  for (const Image& image : bank.frames_dn) {
    findings.require(
        image.rows() == bank.frames_dn[0].rows() && image.cols() == bank.frames_dn[0].cols(),
        "dark frames", "differ in size");
    findings.require(
        !image.empty() && image.rows() % layout.rows() == 0 && image.cols() % layout.cols() == 0,
        "dark frames", "are not made of whole cells of the layout");
    check_map(findings, image, layout, "dark frames");
  }
}

// Maps are of the whole sensor, and a defect is one of its pixels. A model without maps does not
// say how large the sensor is: what uses defects takes its size from a map (DefectList,
// fixed_pattern_at).
void check_places(Findings& findings, const NoiseModel& m) {
  const Image* first = nullptr;
  for (const PhysicsCalibration& p : m.physics)
    for (const Image* map : {&p.dark_shading_dn, &p.prnu_map}) {
      if (map->empty()) continue;
      if (!first) first = map;
      findings.require(map->rows() == first->rows() && map->cols() == first->cols(),
                       gain_prefix(p.gain) + "maps",
                       fmt::format("of {} x {} pixels lie beside others of {} x {}", map->cols(),
                                   map->rows(), first->cols(), first->rows()));
    }
  for (const DefectPixel& d : m.defects)
    findings.require(
        d.row >= 0 && d.col >= 0 && (!first || (d.row < first->rows() && d.col < first->cols())),
        "a defect pixel", fmt::format("lies outside, in row {}, column {}", d.row, d.col));
}

// Gains of one part: known unless there is only one, all in dB or all in ISO, rising.
template <class Calibration>
void check_gains(Findings& findings, const std::vector<Calibration>& calibrations,
                 const std::string& what) {
  for (std::size_t i = 0; i < calibrations.size(); ++i) {
    const GainSetting& gain = calibrations[i].gain;
    findings.require(!(gain.gain_db && gain.iso), what, "names a gain both in dB and in ISO");
    findings.require(gain.decibel() || calibrations.size() == 1, what,
                     "has several gains and does not know one of them");
    findings.require(!gain.iso || *gain.iso > 0, what, "has an ISO that is not positive");
    findings.require(!gain.decibel() || std::isfinite(*gain.decibel()), what,
                     "has a gain that is not finite");
    if (i == 0 || !findings.text().empty()) continue;
    const GainSetting& before = calibrations[i - 1].gain;
    findings.require(before.gain_db.has_value() == gain.gain_db.has_value(), what,
                     "mixes gains in dB and in ISO");
    findings.require(*before.decibel() < *gain.decibel(), what, "has gains that do not rise");
  }
}

void check_sensor(Findings& findings, const NoiseModel& m) {
  const auto n = static_cast<std::size_t>(m.layout.channels());
  check_values(findings, m.black_dn, n, "black level", Need::kRequired);
  check_values(findings, {m.white_dn}, 1, "white level", Need::kRequired);
  findings.require(m.saturation_limit >= 0 && m.saturation_limit <= 1, "saturation limit",
                   fmt::format("is {}, no share of the range", m.saturation_limit));
  for (double black : m.black_dn) {
    findings.require(black < m.white_dn, "black level",
                     fmt::format("{} is not below the white level {}", black, m.white_dn));
    findings.require(m.quantization_dn < m.white_dn - black, "quantization",
                     fmt::format("of {:g} DN leaves no codes", m.quantization_dn));
  }
  findings.require(m.quantization_dn >= 0, "quantization", "is not a step");
  findings.require(m.row_group >= 1 && m.row_group <= 1024, "row group",
                   fmt::format("is {}", m.row_group));
  findings.require(!m.kinds().empty(), "the model", "holds no calibration at all");
}

}  // namespace

std::string contradiction_in(const NoiseModel& m) {
  Findings findings;
  const auto channels = static_cast<std::size_t>(m.layout.channels());
  check_sensor(findings, m);
  check_gains(findings, m.physics, "physics");
  check_gains(findings, m.gaussian, "gaussian");
  check_gains(findings, m.nonparametric, "nonparametric");
  check_gains(findings, m.dark_frames, "dark frames");
  for (const auto& p : m.physics) check_physics(findings, p, m.layout);
  for (const auto& g : m.gaussian) check_gaussian(findings, g, channels);
  for (const auto& n : m.nonparametric) check_nonparametric(findings, n, channels);
  for (const auto& bank : m.dark_frames) check_bank(findings, bank, m.layout);
  check_joint(findings, m);
  check_places(findings, m);
  return findings.text();
}

}  // namespace malus
