#include "malus/calibrate/nonparametric_calibration.h"

#include "malus/base/error.h"
#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/dark_codes.h"
#include "malus/calibrate/geometry.h"
#include "malus/calibrate/row_offset.h"
#include "malus/image/quantization.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

// Variance to expect of a channel's pixels before their levels are measured.
struct ExpectedVariance {
  double dark_dn2 = 0, slope_dn = 0;  ///< rows and all
  double rows_dn2 = 0;                ///< where they are known
  double at(double light_dn) const { return dark_dn2 + slope_dn * std::max(light_dn, 0.0); }
  double of_pixel(double light_dn) const {
    constexpr double kLeastOfDark = 0.05;
    return std::max(at(light_dn) - rows_dn2, kLeastOfDark * dark_dn2);
  }
};

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

// Noise of one frame, row by row of groups, into the channels' histograms.
class LevelPass {
 public:
  LevelPass(const MosaicGeometry& geometry, const std::vector<double>& dark_level_dn,
            const std::vector<double>& bias_dn, const std::vector<double>& row_prior_dn2,
            std::vector<LevelHistograms>& histograms)
      : geometry_(geometry),
        dark_(dark_level_dn),
        bias_(bias_dn),
        row_prior_(row_prior_dn2),
        histograms_(histograms) {}

  void add(View<const float> dn, const CleanFrame& clean) {
    std::vector<double> lamp(dark_.size(), 1.0);
    if (!clean.frame_mean_dn.empty()) {
      const std::vector<double> mean = channel_means(dn, geometry_);
      for (std::size_t c = 0; c < lamp.size(); ++c)
        if (clean.frame_mean_dn[c] > 0) lamp[c] = (mean[c] - dark_[c]) / clean.frame_mean_dn[c];
    }
    for (int group = 0; group < geometry_.groups(); ++group) add_group(dn, clean, lamp, group);
  }
  /// Variance of the group means seen minus what pixels explain: σ_b²; and its standard error.
  double row_variance_dn2(int channel) const {
    return rows_[as_index(channel)].variance() - explained_[as_index(channel)].mean();
  }
  double row_variance_error_dn2(int channel) const {
    // Offsets about their own mean over the frames tell as much as `kept` of their number.
    return rows_[as_index(channel)].variance_standard_error() / std::sqrt(kept_);
  }
  void begin(const CleanFrame& clean, std::vector<ExpectedVariance> expected) {
    expected_ = std::move(expected);
    kept_ = clean.rows_kept;
    rows_.assign(dark_.size(), Moments());
    explained_ = rows_;
  }

 private:
  void add_group(View<const float> dn, const CleanFrame& clean, const std::vector<double>& lamp,
                 int group) {
    const int begin = group * geometry_.row_group();
    const int end = std::min(begin + geometry_.row_group(), geometry_.rows());
    const bool bias_frame = clean.frame_mean_dn.empty();
    for (int channel = 0; channel < geometry_.channels(); ++channel) {
      const auto c = as_index(channel);
      const int n = geometry_.group_pixels(group, channel);
      if (n < 2) continue;
      signal_.clear();
      noise_.clear();
      pixel_kept_.clear();
      variance_.clear();
      double sum = 0, square = 0, kept = 0;
      for (int r = begin; r < end; ++r) {
        if (r % geometry_.cell_rows() != channel / geometry_.cell_cols()) continue;
        for (int col = channel % geometry_.cell_cols(); col < geometry_.cols();
             col += geometry_.cell_cols()) {
          const double light = lamp[c] * clean.light_dn(r, col);
          const double noise = dn(r, col) - dark_[c] - light;
          signal_.push_back(bias_frame ? 0.0 : light);
          noise_.push_back(noise);
          pixel_kept_.push_back(clean.kept(r, col));
          variance_.push_back(pixel_kept_.back() * expected_[c].of_pixel(light));
          kept += pixel_kept_.back() / n;
          sum += noise;
          square += noise * noise;
        }
      }
      const double mean = sum / n, pixel = (square - n * mean * mean) / (n - 1);
      rows_[c].add(mean / std::sqrt(clean.rows_kept));
      explained_[c].add(pixel / n / kept);
      RowOffset offset(row_prior_[c] * clean.rows_kept);
      offset.fit(noise_, variance_);
      for (std::size_t i = 0; i < noise_.size(); ++i) {
        const double own_kept = pixel_kept_[i];
        histograms_[c].add(signal_[i], offset.residual_dn(i) / std::sqrt(own_kept) + bias_[c]);
        histograms_[c].add_square(signal_[i], offset.raw_dn(i), offset.square_dn2(i) / own_kept,
                                  offset.freedom(i) * own_kept);
      }
    }
  }

  const MosaicGeometry& geometry_;
  const std::vector<double>&dark_, &bias_, &row_prior_;
  std::vector<LevelHistograms>& histograms_;
  std::vector<ExpectedVariance> expected_;
  double kept_ = 1.0;
  std::vector<Moments> rows_, explained_;
  std::vector<double> signal_, noise_, pixel_kept_, variance_;
};

// Levels times bins of all channels, four bytes each.
void require_room(double levels, std::size_t channels, const CalibrationSettings& settings) {
  constexpr double kMostCounts = 1 << 28;
  const double counts = levels * settings.bins * static_cast<double>(channels);
  if (counts > kMostCounts)
    throw InputError("--level-step",
                     fmt::format("{:g} DN makes {:.0f} levels of {} bins: {:.1f} GB of counts",
                                 settings.level_step, levels, settings.bins, 4e-9 * counts),
                     fmt::format("raise it to {:.3g} DN or more",
                                 1.01 * settings.level_step * counts / kMostCounts));
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
    require_room(range / step, expected.size(), settings);
    histograms.emplace_back(
        noise_bin_edges(std::sqrt(expected[c].dark_dn2), std::sqrt(expected[c].at(range)),
                        settings.bins, bias_dn[c], codes),
        step, range);
  }
  return histograms;
}

// The dark level: codes as they are, row noise taken out by deconvolution.
void add_dark_codes(const DarkCodes& dark, const RawFrame& first,
                    const std::vector<double>& sigma_row_dn, double step_dn,
                    std::vector<LevelHistograms>& histograms) {
  for (std::size_t c = 0; c < histograms.size(); ++c) {
    std::int64_t first_code = 0;
    const std::vector<double> counts = dark.occurred(static_cast<int>(c), first_code);
    CodeGrid codes = dark.grid(first.black_dn[c]);
    codes.offset_dn += static_cast<double>(first_code) * step_dn;
    histograms[c].set_dark(
        without_row_noise(counts, step_dn, sigma_row_dn[c]), codes,
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
    "take more frames, or lower --level-samples or raise --level-step";

// Above the brightest level that every channel has, its noise is drawn, widened where K is known.
void warn_of_missing_light(const RawFrame& first, const std::vector<RefusedLevels>& refused,
                           std::int64_t wanted, NonparametricCalibration& out) {
  constexpr double kReach = 0.7;
  std::size_t c = 0;
  for (std::size_t i = 1; i < out.channels.size(); ++i)
    if (out.channels[i].level_dn.back() < out.channels[c].level_dn.back()) c = i;
  const double brightest = out.channels[c].level_dn.back();
  const double range = first.white_dn - mean_of(first.black_dn);
  if (!(brightest < kReach * range)) return;
  const std::string few = too_few_between(refused[c], brightest, kReach * range, wanted);
  out.warnings.push_back(fmt::format(
      "no {} above {:.0f} DN, {:.0f} % of the range{}: brighter signals are drawn with that "
      "level's noise{}; {}",
      few.empty() ? "frames" : "levels", brightest, 100 * brightest / range,
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

void finish_channels(const std::vector<LevelHistograms>& histograms, const RawFrame& first,
                     const CalibrationSettings& settings, NonparametricCalibration& out) {
  std::vector<RefusedLevels> refused;
  std::size_t all_refused = 0;
  for (std::size_t c = 0; c < histograms.size(); ++c) {
    auto result = histograms[c].result(settings.level_samples);
    if (result.channel.level_dn.size() < 2)
      throw InputError(
          fmt::format("{}, channel {}", out.gain.text(),
                      first.layout.channel_name(static_cast<int>(c))),
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
  warn_of_missing_light(first, refused, settings.level_samples, out);
}

}  // namespace

MeasuredLevels measure_levels(const std::vector<NoiseSource>& sources, const RawFrame& first,
                              const PhysicsCalibration* physics, int row_group,
                              const CalibrationSettings& settings, Progress& progress) {
  const MosaicGeometry geometry(first.layout, first.dn.rows(), first.dn.cols(), row_group);
  std::vector<double> bias(as_index(geometry.channels()), 0.0);
  if (physics) bias = physics->mu.mean;
  DarkLevel dark{first.black_dn, physics != nullptr};
  for (std::size_t c = 0; c < bias.size(); ++c) dark.dn[c] += bias[c];
  MeasuredLevels measured;
  NonparametricCalibration& out = measured.distributions;
  out.gain = sources.front().frames->gain;
  if (physics) out.K = physics->K.mean;
  std::vector<LevelHistograms> histograms;
  const std::vector<double> row_prior = row_prior_dn2(physics, bias.size());
  LevelPass pass(geometry, dark.dn, bias, row_prior, histograms);
  const double step_dn = quantization_step(first.dn);
  // Integer dark frames have their own way, where row noise is known.
  const bool by_code = physics && step_dn > 0;
  DarkCodes codes(geometry, first, by_code ? step_dn : 1.0);
  double darkest = std::numeric_limits<double>::infinity();
  std::vector<double> row_variance(bias.size()), row_error(bias.size());
  for (const NoiseSource& source : sources) {
    if (source.frames->count < 2) continue;
    out.frames += source.frames->count;
    if (by_code && source.frames->kind == FrameKind::kBias) {
      for_each_frame(*source.frames, &first, progress,
                     [&](const RawFrame& frame, int) { codes.add(frame.dn); });
      progress.advance(source.frames->count);  // one pass was enough
      continue;
    }
    const CleanFrame clean = measure_clean(source, first, geometry, dark, progress);
    const std::vector<ExpectedVariance> expected = expected_variance(clean, physics);
    if (histograms.empty()) histograms = make_histograms(first, expected, bias, step_dn, settings);
    pass.begin(clean, expected);
    for_each_frame(*source.frames, &first, progress,
                   [&](const RawFrame& frame, int) { pass.add(frame.dn, clean); });
    const double light = clean.frame_mean_dn.empty() ? -1.0 : mean_of(clean.frame_mean_dn);
    if (light >= darkest) continue;
    darkest = light;
    for (int c = 0; c < geometry.channels(); ++c) {
      row_variance[as_index(c)] = pass.row_variance_dn2(c);
      row_error[as_index(c)] = pass.row_variance_error_dn2(c);
    }
  }
  if (histograms.empty())
    throw InputError(out.gain.text(), "has no set of two frames or more of one scene",
                     "noise is told from the scene by repeating the frame");
  if (codes.frames() > 0)
    add_dark_codes(codes, first, physics->sigma_row.mean, step_dn, histograms);
  finish_channels(histograms, first, settings, out);
  for (std::size_t c = 0; c < bias.size(); ++c) {
    const double sigma = std::sqrt(std::max(row_variance[c], 0.0));
    out.sigma_row_dn.push_back(physics ? physics->sigma_row.mean[c] : sigma);
    out.sigma_row_stderr_dn.push_back(
        physics ? physics->sigma_row.standard_error[c]
                : 0.5 * (std::sqrt(sigma * sigma + 2 * row_error[c]) - sigma));
    measured.noise.push_back(histograms[c].noise());
    if (!physics) continue;
    row_variance[c] = std::pow(out.sigma_row_dn[c], 2);
    row_error[c] = 2.0 * out.sigma_row_dn[c] * out.sigma_row_stderr_dn[c];
  }
  if (physics) out.row_drift = physics->row_drift;
  measured.row_variance_dn2 = std::move(row_variance);
  measured.row_variance_stderr_dn2 = std::move(row_error);
  measured.bias_dn = std::move(bias);
  return measured;
}

}  // namespace malus
