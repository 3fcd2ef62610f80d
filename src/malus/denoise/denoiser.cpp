#include "malus/denoise/denoiser.h"

#include "malus/base/parallel.h"
#include "malus/base/settings_check.h"
#include "malus/base/stopwatch.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/denoise/cut_off.h"
#include "malus/denoise/frame_complaints.h"
#include "malus/denoise/internal/baselines.h"
#include "malus/denoise/internal/bm3d_mix.h"
#include "malus/denoise/internal/censored_error.h"
#include "malus/denoise/internal/frame_filter.h"
#include "malus/denoise/internal/joint_bilateral.h"
#include "malus/denoise/internal/kept_points.h"
#include "malus/denoise/internal/missed_signal.h"
#include "malus/denoise/internal/residual_evidence.h"
#include "malus/denoise/internal/within_codes.h"
#include "malus/denoise/prepared_frame.h"
#include "malus/noise/rounding.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

#include <fmt/format.h>

namespace malus {
namespace {

// A picture shows its noise too large where it has texture: this share of its variance is sure
// (docs/denoising-experiments.md, "Pixels that are alike").
constexpr double kSureNoise = 0.9;

// Nearer to white, in deviations of the noise, it is cut off, and residuals are smaller and below
// zero whatever the estimate.
constexpr double kFromWhite = 2;

// Up to where the noise of stabilised samples is whole, per channel.
std::vector<float> uncut_samples(const std::vector<Stabilizer>& stabilizers,
                                 const PreparedFrame& frame) {
  std::vector<float> uncut;
  for (std::size_t k = 0; k < stabilizers.size(); ++k)
    uncut.push_back(static_cast<float>(stabilizers[k].forward(frame.saturated_dn[k]) - kFromWhite));
  return uncut;
}

// Mean square of what rounding changes and no averaging finds, where a channel has this variance.
double undithered(const NoiseProfile& profile, double variance_dn2) {
  const double rounding = profile.step_dn * profile.step_dn / 12;
  return undithered_variance(profile.step_dn, std::max(variance_dn2 - rounding, 0.0));
}

// Where that is this share of the variance, a step hides the noise: residuals do not tell of
// errors.
constexpr double kMostUndithered = 0.01;

bool hides_noise(const NoiseProfile& profile, const ChannelProfile& channel, double dn) {
  const double variance_dn2 = channel.variance(dn);
  return undithered(profile, variance_dn2) > kMostUndithered * variance_dn2;
}

// Of the noise that the profile tells, what a step that hides it lets samples of this light show:
// least where the light is a code. White, as frames count it, is one. The estimate that tells the
// light is not sure, so half is taken to show anyway: without it print that lies on codes keeps
// its noise, at nine tenths weaves are taken for print (docs/denoising-experiments.md, "Pixels that
// are alike").
double shown_share(const NoiseProfile& profile, const ChannelProfile& channel, double white_dn,
                   double dn) {
  constexpr double kAnyway = 0.5;
  const double step = profile.step_dn, told_dn2 = channel.variance(dn),
               own_dn2 = std::max(told_dn2 - step * step / 12, 1e-6 * step * step);
  const double shown = std::min(rounded_variance(step, dn - white_dn, own_dn2) / told_dn2, 1.0);
  return kAnyway + (1 - kAnyway) * shown;
}

// What is told of a frame's noise, and the same with what it shows between two codes.
struct ToldNoise {
  const NoiseProfile& profile;
  const NoiseProfile& of_frame;
  // Between two codes the frame itself shows it.
  bool is_shown(std::size_t channel, double dn) const {
    return of_frame.channels[channel].variance(dn) > profile.channels[channel].variance(dn);
  }
};

// A lower bound of the noise variance of stabilised samples, never above what the filter was told.
// In the dark the law itself has less than this bound, and texture is lost in noise.
internal::SampleNoise sure_noise(const std::vector<Stabilizer>& stabilizers,
                                 const std::vector<float>& uncut, const PreparedFrame& frame,
                                 const ToldNoise& noise, const Denoised& result) {
  const NoiseProfile& profile = noise.profile;
  std::vector<StabilizedVariance> variances;
  std::vector<bool> may_hide;  // some of its light
  for (std::size_t k = 0; k < stabilizers.size(); ++k) {
    variances.emplace_back(stabilizers[k], frame.highest_dn,
                           noise.of_frame.channels[k].distribution());
    may_hide.push_back(hides_noise(profile, profile.channels[k], 0));
  }
  const bool own = profile.estimated_from_picture;
  const double share = own ? 1 : sure_noise_share(result.noise), most = own ? kSureNoise : 1;
  const auto hides = [&stabilizers, &profile, may_hide](std::size_t channel, float mean) {
    return may_hide[channel] &&
           hides_noise(profile, profile.channels[channel], stabilizers[channel].inverse(mean));
  };
  const auto variance = [&stabilizers, &frame, noise, hides, variances = std::move(variances),
                         share, most](std::size_t k, float mean) {
    const double told = std::min(share * variances[k].at(mean), most);
    if (!hides(k, mean)) return static_cast<float>(told);
    const double dn = stabilizers[k].inverse(mean);
    if (noise.is_shown(k, dn)) return static_cast<float>(told);
    return static_cast<float>(
        told * shown_share(noise.profile, noise.profile.channels[k], frame.saturated_dn[k], dn));
  };
  return {uncut, variance, hides, own ? 0.0f : static_cast<float>(share)};
}

// From the stabilised estimate and its error back to DN.
void invert(const std::vector<Stabilizer>& stabilizers, const PreparedFrame& frame,
            Denoised& result) {
  parallel_for(0, frame.dn.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int row = static_cast<int>(begin); row < static_cast<int>(end); ++row)
      for (int col = 0; col < frame.dn.cols(); ++col) {
        const Stabilizer& stabilizer =
            stabilizers[static_cast<std::size_t>(frame.layout.channel_at(row, col))];
        const double value = result.dn_above_black(row, col);
        result.dn_above_black(row, col) = static_cast<float>(stabilizer.inverse(value));
        if (result.variance_dn2) {
          const double slope = stabilizer.inverse_slope(value);
          (*result.variance_dn2)(row, col) *= static_cast<float>(slope * slope);
        }
      }
  });
}

// A saturated pixel is at least as bright as it says: nothing better is known.
void keep_saturated(const PreparedFrame& frame, Image& dn_above_black) {
  parallel_for(0, frame.dn.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int row = static_cast<int>(begin); row < static_cast<int>(end); ++row)
      for (int col = 0; col < frame.dn.cols(); ++col)
        if (frame.saturated(row, col)) dn_above_black(row, col) = frame.dn(row, col);
  });
}

// What the filter does not see as an error. Noise that a strength below 1 declares absent passes
// almost unfiltered, as detail does (docs/uncertainty.md has the measurement). Row and
// column offsets are the same in everything that it averages, and so is what rounding does to noise
// below a step.
void add_unseen_errors(const PreparedFrame& frame, const NoiseProfile& profile, double strength,
                       Denoised& result) {
  Image& variance_dn2 = *result.variance_dn2;
  const double left = std::max(1 - strength * strength, 0.0);
  parallel_for(0, frame.dn.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int row = static_cast<int>(begin); row < static_cast<int>(end); ++row) {
      const double rows = frame.row_variance[static_cast<std::size_t>(row / profile.row_group)];
      for (int col = 0; col < frame.dn.cols(); ++col) {
        const ChannelProfile& channel =
            profile.channels[static_cast<std::size_t>(frame.layout.channel_at(row, col))];
        const double variance = channel.variance(result.dn_above_black(row, col));
        const double columns = frame.column_variance[static_cast<std::size_t>(col)];
        double unseen = rows * channel.sigma_row_dn * channel.sigma_row_dn +
                        columns * channel.sigma_column_dn * channel.sigma_column_dn +
                        left * variance + undithered(profile, variance - channel.guessed_dn2);
        // How much brighter than white a saturated pixel is, nobody knows.
        if (frame.saturated(row, col)) unseen = std::numeric_limits<double>::quiet_NaN();
        variance_dn2(row, col) += static_cast<float>(unseen);
      }
    }
  });
  add_censoring_error(frame, profile, result.dn_above_black.view(), variance_dn2);
  for (const FilledPixel& p : frame.filled) variance_dn2(p.row, p.col) += p.variance_dn2;
}

// Where blocks have no copies, as in crisp stripes at low light, an estimate errs by more than it
// states; a mix states what Stein's estimate has found of it (docs/denoising-experiments.md,
// "Pixels that are alike").
constexpr float kErrorOfStated = 1.4f;

// report.cell_error becomes what average_alike_pixels takes for the error; it is not filled where
// nothing asks for it.
internal::FrameTiles filter_stabilised(const FrameSource& frame, const DenoiseSettings& settings,
                                       const internal::MemoryBudget& memory, Image& estimate,
                                       internal::FrameReport report, Progress& progress) {
  std::optional<internal::Bm3dMix> mix;
  if (internal::mixes_bm3d(settings.method, settings.profile, frame.layout))
    mix = internal::plan_bm3d_mix(settings.profile, frame.rows, frame.cols, memory);
  if (!mix && !settings.like_pixels) report.cell_error = nullptr;
  const internal::FrameTiles tiles = internal::filter_frame(
      frame, mosaic_filter_plan(settings.method, settings.profile, frame.layout), memory, estimate,
      report, progress);
  if (mix)
    internal::mix_bm3d(*mix, frame.pixel, *report.cell_error, estimate, progress);
  else if (report.cell_error)
    for (float& error : report.cell_error->values()) error *= kErrorOfStated;
  return tiles;
}

}  // namespace

void filter_prepared(const PreparedFrame& frame, const NoiseProfile& profile,
                     const DenoiseSettings& settings, Progress& progress, Denoised& result) {
  result.dn_above_black = Image(frame.dn.rows(), frame.dn.cols());
  const NoiseProfile of_frame = internal::with_noise_between_codes(profile, frame);
  const auto stabilizers = make_stabilizers(of_frame, frame.highest_dn, settings.strength);
  const FrameSource stabilised{
      [&](int r, int c) {
        const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
        return static_cast<float>(stabilizers[channel].forward(frame.dn(r, c)));
      },
      frame.layout, frame.dn.rows(), frame.dn.cols()};
  Image* const error = result.variance_dn2 ? &*result.variance_dn2 : nullptr;
  const int frames = (error ? 3 : 2) + (profile.pattern ? 2 : 0);
  const internal::MemoryBudget memory{
      settings.memory_mib, frames * static_cast<double>(frame.dn.size()) + settings.held_values};
  Image cell_error(internal::cell_count(frame.dn.rows()), internal::cell_count(frame.dn.cols()));
  const auto tell_work = [&](const internal::FrameTiles& tiles) {
    const std::string line = tile_work_complaint(tiles.count, tiles.work, tiles.whole_mib);
    if (!line.empty()) progress.warn_of(frame.source, line);
  };
  const internal::FrameTiles tiles = filter_stabilised(
      stabilised, settings, memory, result.dn_above_black,
      {.error = error, .cell_error = &cell_error, .planned = tell_work}, progress);
  result.tiles = tiles.count;
  result.tile_work = tiles.work;
  const std::vector<float> uncut = uncut_samples(stabilizers, frame);
  const internal::SampleNoise noise =
      sure_noise(stabilizers, uncut, frame, {profile, of_frame}, result);
  if (settings.like_pixels)
    internal::average_alike_pixels(stabilised, noise, memory,
                                   {result.dn_above_black, cell_error, error}, progress);
  check_stop(progress);
  if (error) {
    internal::add_missed_signal(stabilised, uncut, result.dn_above_black, *error);
    internal::state_residual_evidence(stabilised, noise, result.dn_above_black, *error);
  }
  invert(stabilizers, frame, result);
  keep_saturated(frame, result.dn_above_black);
  keep_points(frame, profile, stabilizers, result);
  if (result.variance_dn2) add_unseen_errors(frame, profile, settings.strength, result);
}

const std::vector<DenoiseMethod>& denoise_methods() {
  static const std::vector<DenoiseMethod> methods = {
      {"nl-ridge", "calibrated, joint over all channels, adaptive to local colour and polarization",
       MosaicFilter::kRidge},
      {"bm3d", "the same with a Wiener filter in the last pass and one coarse scale",
       MosaicFilter::kWiener},
      {"vst-pfcd", "baseline: vst-pca-bm3d on every alignment of cell and mosaic, averaged (PFCD)",
       MosaicFilter::kNone},
      {"vst-pca-bm3d", "baseline: stabilised, principal components, each filtered alone",
       MosaicFilter::kNone},
      {"vst-stokes-bm3d", "baseline: stabilised, Stokes components matched on S0 (PBM3D)",
       MosaicFilter::kNone},
      {"vst-bm3d", "baseline: stabilised, each plane filtered alone", MosaicFilter::kNone},
      {"paper-mbm3d", "baseline: all planes jointly with one estimated deviation",
       MosaicFilter::kNone, false},
      {"paper-bm3d",
       "baseline: each colour's four angles as one grey picture with its estimated deviation",
       MosaicFilter::kNone, false},
      {"plane-bm3d", "baseline: each plane alone with its estimated deviation", MosaicFilter::kNone,
       false},
  };
  return methods;
}

const DenoiseMethod& denoise_method(const std::string& name, const std::string& also) {
  std::vector<std::string> names;
  for (const DenoiseMethod& method : denoise_methods()) {
    if (method.name == name) return method;
    names.push_back(method.name);
  }
  if (name.ends_with(".safetensors"))
    throw InputError(setting("method", name), "is a network, which this library does not run",
                     "run malus denoise with it, or choose one of " + joined(names));
  throw InputError(setting("method", name), "is no method",
                   did_you_mean(name, names) + "there are " + joined(names) + also);
}

Denoised denoise_frame(RawFrame frame, const NoiseProfile& given, const DenoiseSettings& settings,
                       Progress& progress, bool want_variance) {
  const DenoiseMethod& method = denoise_method(settings.method);
  require_settings(settings);
  check_frame(frame, given);
  if (want_variance && !method.on_mosaic())
    throw InputError(setting("method", method.name), "gives no uncertainty",
                     "use nl-ridge or bm3d");
  Denoised result;
  const Stopwatch preparation;
  const CutOff cut_off = measure_cut_off(frame);
  check_stop(progress);
  const NoiseProfile profile = as_shown(before_cut_off(given, frame), frame, cut_off);
  result.cut_off_share = cut_off.mean_share();
  result.frames_cut_off_share = cut_off_share_of_mean(frame, given);
  result.cut_off_undone = method.stabilizes && has_cut_off_law(profile);
  const PreparedFrame prepared =
      prepare_frame(std::move(frame), profile,
                    {.remove_rows = settings.row_noise && method.on_mosaic(),
                     .remove_columns = settings.column_noise && method.on_mosaic(),
                     .fill_defects = settings.defects,
                     .fill_impulses = settings.defects && method.on_mosaic(),
                     .remove_pattern = settings.fixed_pattern},
                    result);
  const double preparation_s = preparation.seconds();
  check_stop(progress);
  const Stopwatch filter;
  if (want_variance) result.variance_dn2 = Image(prepared.dn.rows(), prepared.dn.cols());
  if (method.on_mosaic()) {
    filter_prepared(prepared, profile, settings, progress, result);
  } else {
    result.dn_above_black =
        internal::run_baseline(method.name, prepared, profile, settings, progress);
    keep_saturated(prepared, result.dn_above_black);
  }
  if (result.cut_off_undone) keep_voids(cut_off, result.dn_above_black);
  complete_result(prepared, result);
  result.times = {{"preparation and row noise", preparation_s}, {"filter", filter.seconds()}};
  return result;
}

}  // namespace malus
