#include "malus/calibrate/nonparametric_calibration.h"

#include "malus/base/error.h"
#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/base/wording.h"
#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/dark_codes.h"
#include "malus/calibrate/internal/level_pass.h"
#include "malus/image/quantization.h"
#include "malus/noise/model_limits.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

std::vector<ExpectedVariance> expected_variance(const CleanFrame& clean,
                                                const PhysicsCalibration* physics) {
  std::vector<ExpectedVariance> out;
  for (std::size_t c = 0; c < clean.dark_variance_dn2.size(); ++c) {
    double dark = clean.dark_variance_dn2[c], slope = clean.slope_dn[c];
    if (physics) dark = std::pow(physics->temporal_sd_dark_dn[c], 2);
    if (physics && !physics->K.mean.empty()) slope = physics->K.mean[c];
    const double rows = physics ? std::pow(physics->sigma_row.mean[c], 2) : 0.0;
    out.push_back({std::max(dark, 1e-6), slope, rows});
  }
  return out;
}

// Of a row's offset in one frame: row noise, and the dark level's own drift from frame to frame.
// Infinite where bias frames have not told it.
std::vector<double> row_prior_dn2(const PhysicsCalibration* physics, std::size_t channels) {
  std::vector<double> out(channels, std::numeric_limits<double>::infinity());
  if (!physics || physics->bias_frames < 2) return out;
  for (std::size_t c = 0; c < channels; ++c)
    out[c] = std::pow(physics->sigma_row.mean[c], 2) + std::pow(physics->mu.spread[c], 2);
  return out;
}

// Levels times bins: of all channels as counts of four bytes, of one as a model file's numbers.
void require_room(double levels, std::size_t bins, std::size_t channels,
                  const CalibrationSettings& settings) {
  constexpr double kMostCounts = 1 << 28, kMostOfChannel = static_cast<double>(kMostModelValues);
  const double of_channel = levels * static_cast<double>(bins),
               counts = of_channel * static_cast<double>(channels);
  const double excess = std::max(counts / kMostCounts, of_channel / kMostOfChannel);
  if (excess > 1)
    throw InputError(
        setting_name("level_step"),
        fmt::format("{:g} DN makes {:.0f} levels of {} bins: {}", settings.level_step, levels, bins,
                    counts > kMostCounts
                        ? fmt::format("{:.1f} GB of counts", 4e-9 * counts)
                        : fmt::format("more than the {} numbers of a channel that a model file "
                                      "holds",
                                      kMostModelValues)),
        fmt::format("raise it to {:.3g} DN or more", 1.01 * settings.level_step * excess));
}

// Histograms whose bins suit the darkest and the brightest noise that can be expected.
std::vector<LevelHistograms> make_histograms(const RawFrame& first,
                                             const std::vector<ExpectedVariance>& expected,
                                             const std::vector<double>& bias_dn, double step_dn,
                                             const CalibrationSettings& settings) {
  std::vector<LevelHistograms> histograms;
  for (std::size_t c = 0; c < expected.size(); ++c) {
    const double range = first.white_dn - first.black_dn[c];
    const CodeGrid codes{step_dn,
                         step_dn > 0 ? std::fmod(first.dn(0, 0), step_dn) - first.black_dn[c] : 0};
    const double step = settings.level_step > 0 ? settings.level_step : range / 256.0;
    auto edges = noise_bin_edges(std::sqrt(expected[c].dark_dn2), std::sqrt(expected[c].at(range)),
                                 settings.bins, bias_dn[c], codes);
    require_room(std::floor(range / step) + 2, edges.size() - 1, expected.size(), settings);
    histograms.emplace_back(std::move(edges), step, range);
  }
  return histograms;
}

// The dark level: what lies behind the codes, row noise taken out by deconvolution.
void add_dark_codes(const DarkCodes& dark, const std::vector<double>& black_dn,
                    const PhysicsCalibration& physics, double step_dn,
                    std::vector<LevelHistograms>& histograms) {
  const std::vector<double>& at_floor = physics.dark_zero_share;  // the lowest code that occurs
  for (std::size_t c = 0; c < histograms.size(); ++c) {
    std::int64_t first_code = 0;
    const std::vector<double> counts = dark.occurred(static_cast<int>(c), first_code);
    const bool is_cut_off = c < at_floor.size() && at_floor[c] > kMostSilentZeros;
    const DarkDensity density =
        without_row_noise(counts, step_dn, physics.sigma_row.mean[c], is_cut_off);
    CodeGrid places = dark.grid(black_dn[c]);
    const double below = static_cast<double>(density.codes_below);
    places.offset_dn += (static_cast<double>(first_code) - below) * step_dn - 0.5 * step_dn;
    places.step_dn = step_dn / density.parts;
    places.offset_dn += 0.5 * places.step_dn;
    histograms[c].set_dark(
        density.probability, places,
        static_cast<std::int64_t>(std::accumulate(counts.begin(), counts.end(), 0.0)));
  }
}

// Signals of one channel that frames hold, with too few samples for a level of their own.
using RefusedLevels = std::vector<std::pair<double, std::int64_t>>;

// What the frames hold between two signals without a level of their own; empty where that leaves
// most of the distance open: the tails of a flat's noise reach a little beyond it.
std::string too_few_between(const RefusedLevels& refused, double low_dn, double high_dn,
                            std::int64_t wanted) {
  constexpr double kMostOpen = 0.8;
  int levels = 0;
  std::int64_t most = 0;
  double brightest = low_dn, open = 0;
  for (const auto& [signal, samples] : refused) {  // rising
    if (!(signal > low_dn && signal < high_dn)) continue;
    ++levels;
    most = std::max(most, samples);
    open = std::max(open, signal - brightest);
    brightest = signal;
  }
  open = std::max(open, high_dn - brightest);
  if (open > kMostOpen * (high_dn - low_dn)) return {};
  return fmt::format(
      "there are signals of up to {:.0f} DN, but their {} levels have {} samples or fewer "
      "with their neighbours, and {} are needed",
      brightest, levels, most, wanted / 10);
}

constexpr const char* kMoreSamples =
    "take more frames, ask for fewer samples per level or set the levels further apart";

// Above the brightest level that every channel has, its noise is drawn, widened where K is known.
void warn_of_missing_light(double range_dn, const std::vector<RefusedLevels>& refused,
                           std::int64_t wanted, NonparametricCalibration& out) {
  constexpr double kReach = 0.7;
  std::size_t c = 0;
  for (std::size_t i = 1; i < out.channels.size(); ++i)
    if (out.channels[i].level_dn.back() < out.channels[c].level_dn.back()) c = i;
  const double brightest = out.channels[c].level_dn.back();
  if (!(brightest < kReach * range_dn)) return;
  const std::string few = too_few_between(refused[c], brightest, kReach * range_dn, wanted);
  out.warnings.push_back(fmt::format(
      "no {} above {:.0f} DN, {:.0f} % of the range{}: brighter signals are drawn with that "
      "level's noise{}; {}",
      few.empty() ? "frames" : "levels", brightest, 100 * brightest / range_dn,
      few.empty() ? "" : " (" + few + ")",
      out.K.empty() ? ", which is too weak there" : ", widened as shot noise grows",
      few.empty() ? "take brighter frames" : kMoreSamples));
}

// Between two levels draws are mixed from both: of unlike variances, v and r v, the mixture's
// excess kurtosis reaches 3 ((r + 1)² / (4 r) - 1), which is 1.7 for r = 4.
void warn_of_gaps(const std::vector<RefusedLevels>& refused, std::int64_t wanted,
                  NonparametricCalibration& out) {
  constexpr double kMostRise = 4.0;
  double most = kMostRise, low_dn = 0, high_dn = 0;
  std::string few;
  for (std::size_t c = 0; c < out.channels.size(); ++c) {
    const NonparametricChannel& channel = out.channels[c];
    for (std::size_t i = 1; i < channel.level_dn.size(); ++i) {
      const double below = level_moments(channel, i - 1).variance_dn2;
      const double rise = level_moments(channel, i).variance_dn2 / below;
      if (!(rise > most)) continue;
      most = rise;
      low_dn = channel.level_dn[i - 1];
      high_dn = channel.level_dn[i];
      few = too_few_between(refused[c], low_dn, high_dn, wanted);
    }
  }
  if (most > kMostRise)
    out.warnings.push_back(fmt::format(
        "no {} between {:.0f} and {:.0f} DN, where the noise's variance rises {:.0f}-fold{}: "
        "signals between them get a mixture of both with heavy tails; {}",
        few.empty() ? "frames" : "levels", low_dn, high_dn, most,
        few.empty() ? "" : " (" + few + ")",
        few.empty() ? "take flats in between, or an unevenly lit scene" : kMoreSamples));
}

void finish_channels(const std::vector<LevelHistograms>& histograms, const FrameFormat& format,
                     const CalibrationSettings& settings, NonparametricCalibration& out) {
  std::vector<RefusedLevels> refused;
  std::size_t all_refused = 0;
  for (std::size_t c = 0; c < histograms.size(); ++c) {
    auto result = histograms[c].result(settings.level_samples);
    if (result.channel.level_dn.size() < 2)
      throw InputError(
          fmt::format("{}, channel {}", out.gain.text(),
                      format.layout.channel_name(static_cast<int>(c))),
          fmt::format("signal levels with a tenth of {} samples or more: {}, 2 are needed",
                      settings.level_samples, result.channel.level_dn.size()),
          kMoreSamples);
    out.channels.push_back(std::move(result.channel));
    all_refused += result.refused.size();
    refused.push_back(std::move(result.refused));
  }
  if (all_refused > 0)
    out.warnings.push_back(fmt::format(
        "{} signal levels of all channels together were left out: fewer than {} samples even with "
        "their neighbours",
        all_refused, settings.level_samples / 10));
  warn_of_gaps(refused, settings.level_samples, out);
  warn_of_missing_light(format.mean_range_dn(), refused, settings.level_samples, out);
}

// How many frames tell the noise's shape where they are compared with their own mean.
class ShapeFrames {
 public:
  void add(const NoiseSource& source) {
    if (source.frames->kind == FrameKind::kBias) return;
    const bool is_enough = source.frames->count >= kEnough;
    told_apart_ =
        told_apart_ || source.reference || (is_enough && source.frames->kind == FrameKind::kBurst);
    fewest_ = std::min(fewest_, source.frames->count);
  }
  // Each frame has its share in the mean of N: of x - mean the third cumulant has (1 - 1/N)
  // (1 - 2/N) of the noise's, the variance 1 - 1/N.
  void warn(NonparametricCalibration& out) const {
    if (told_apart_ || fewest_ >= kEnough) return;
    const double lost = 1.0 - (1.0 - 2.0 / fewest_) / std::sqrt(1.0 - 1.0 / fewest_);
    out.warnings.push_back(fmt::format(
        "flats of {} frames: compared with their own mean, {:.0f} % of the noise's skewness is "
        "lost; take {} frames or more a level, or a burst with a reference",
        fewest_, 100 * lost, kEnough));
  }

 private:
  static constexpr int kEnough = 8;  // a fifth is lost
  int fewest_ = std::numeric_limits<int>::max();
  bool told_apart_ = false;
};

// One gain's noise, source by source.
class GainLevels {
 public:
  GainLevels(const RawFrame& first, const PhysicsCalibration* physics, int row_group,
             const CalibrationSettings& settings)
      : first_(first),
        format_(format_of(first)),
        physics_(physics),
        settings_(settings),
        geometry_(format_.geometry(row_group)),
        bias_dn_(physics ? physics->mu.mean : std::vector<double>(first.black_dn.size(), 0.0)),
        dark_{first.black_dn, physics != nullptr},
        step_dn_(quantization_step(first.dn)),
        codes_(geometry_, first.dn, by_code() ? step_dn_ : 1.0),
        row_prior_dn2_(row_prior_dn2(physics, bias_dn_.size())),
        pass_(geometry_, dark_.dn, bias_dn_, row_prior_dn2_, histograms_),
        row_variance_dn2_(bias_dn_.size()),
        row_error_dn2_(bias_dn_.size()) {
    for (std::size_t c = 0; c < bias_dn_.size(); ++c) dark_.dn[c] += bias_dn_[c];
  }
  // pass_ refers to its neighbours.
  GainLevels(const GainLevels&) = delete;
  GainLevels& operator=(const GainLevels&) = delete;

  void add(const NoiseSource& source, Progress& progress) {
    frames_ += source.frames->count;
    shape_frames_.add(source);
    if (by_code() && source.frames->kind == FrameKind::kBias) {
      for_each_frame(*source.frames, &format_, progress,
                     [&](const RawFrame& frame, int) { codes_.add(frame.dn); });
      progress.advance(source.frames->count);  // one pass was enough
      return;
    }
    const CleanFrame clean = measure_clean(source, format_, geometry_, dark_, progress);
    const std::vector<ExpectedVariance> expected = expected_variance(clean, physics_);
    if (histograms_.empty())
      histograms_ = make_histograms(first_, expected, bias_dn_, step_dn_, settings_);
    pass_.begin(clean, expected);
    for_each_frame(*source.frames, &format_, progress,
                   [&](const RawFrame& frame, int) { pass_.add(frame.dn, clean); });
    keep_rows_of_darkest(clean.frame_mean_dn.empty() ? -1.0 : mean_of(clean.frame_mean_dn));
  }

  MeasuredLevels result(const GainSetting& gain) {
    MeasuredLevels measured;
    NonparametricCalibration& out = measured.distributions;
    out.gain = gain;
    out.frames = frames_;
    if (physics_) out.K = physics_->K.mean;
    if (physics_) out.row_drift = physics_->row_drift;
    if (histograms_.empty())
      throw InputError(out.gain.text(), "has no set of two frames or more of one scene",
                       "noise is told from the scene by repeating the frame");
    if (codes_.frames() > 0)
      add_dark_codes(codes_, format_.black_dn, *physics_, step_dn_, histograms_);
    finish_channels(histograms_, format_, settings_, out);
    shape_frames_.warn(out);
    for (const LevelHistograms& channel : histograms_) measured.noise.push_back(channel.noise());
    fill_rows(measured);
    measured.bias_dn = bias_dn_;
    return measured;
  }

 private:
  // Integer dark frames have their own way, where row noise is known.
  bool by_code() const { return physics_ && step_dn_ > 0; }

  void keep_rows_of_darkest(double light_dn) {
    if (light_dn >= darkest_dn_) return;
    darkest_dn_ = light_dn;
    for (int c = 0; c < geometry_.channels(); ++c) {
      row_variance_dn2_[as_index(c)] = pass_.row_variance_dn2(c);
      row_error_dn2_[as_index(c)] = pass_.row_variance_error_dn2(c);
    }
  }

  void fill_rows(MeasuredLevels& measured) const {
    NonparametricCalibration& out = measured.distributions;
    if (physics_) {
      out.sigma_row_dn = physics_->sigma_row.mean;
      out.sigma_row_stderr_dn = physics_->sigma_row.standard_error;
      for (std::size_t c = 0; c < bias_dn_.size(); ++c) {
        measured.row_variance_dn2.push_back(std::pow(out.sigma_row_dn[c], 2));
        measured.row_variance_stderr_dn2.push_back(2.0 * out.sigma_row_dn[c] *
                                                   out.sigma_row_stderr_dn[c]);
      }
      return;
    }
    measured.row_variance_dn2 = row_variance_dn2_;
    measured.row_variance_stderr_dn2 = row_error_dn2_;
    for (std::size_t c = 0; c < bias_dn_.size(); ++c) {
      const double sigma = std::sqrt(std::max(row_variance_dn2_[c], 0.0));
      out.sigma_row_dn.push_back(sigma);
      out.sigma_row_stderr_dn.push_back(0.5 *
                                        (std::sqrt(sigma * sigma + 2 * row_error_dn2_[c]) - sigma));
    }
  }

  const RawFrame& first_;
  FrameFormat format_;
  const PhysicsCalibration* physics_;
  const CalibrationSettings& settings_;
  MosaicGeometry geometry_;
  std::vector<double> bias_dn_;
  DarkLevel dark_;
  double step_dn_;
  DarkCodes codes_;
  std::vector<double> row_prior_dn2_;
  std::vector<LevelHistograms> histograms_;
  LevelPass pass_;
  ShapeFrames shape_frames_;
  int frames_ = 0;
  double darkest_dn_ = std::numeric_limits<double>::infinity();
  std::vector<double> row_variance_dn2_, row_error_dn2_;
};

}  // namespace

MeasuredLevels measure_levels(const LevelFrames& frames, const PhysicsCalibration* physics,
                              int row_group, const CalibrationSettings& settings,
                              Progress& progress) {
  GainLevels levels(frames.first, physics, row_group, settings);
  for (const NoiseSource& source : frames.sources)
    if (source.frames->count >= 2) levels.add(source, progress);
  return levels.result(frames.sources.front().frames->gain);
}

}  // namespace malus
