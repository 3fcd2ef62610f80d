// Do two sets of frames hold the same noise? Divergences per signal level and pooled, and what
// distributions of single pixels cannot see: row noise and correlation between neighbours.
#pragma once

#include "malus/base/estimate.h"
#include "malus/base/parameter.h"
#include "malus/base/progress.h"
#include "malus/base/quantity.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <cstdint>
#include <functional>
#include <optional>
#include <vector>

namespace malus {

struct NoiseComparisonSettings {
  int bins = 128;
  int levels = 16;
  bool remove_fixed_pattern = false;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.bins, ParameterInfo{"bins", "1", "bins of each histogram", 8, 65536});
    field(self.levels,
          ParameterInfo{"levels", "1", "signal levels between dark and bright", 1, 4096});
    field(
        self.remove_fixed_pattern,
        ParameterInfo{"remove_fixed_pattern", "",
                      "subtract each set's mean frame, so that temporal noise alone is compared"});
  }
};

/// Frames that are loaded when they are needed: mosaics in DN above black, all of one size.
struct NoiseFrames {
  int count = 0;
  std::function<Image(int)> load;
};

/// Distances of one level, or of all samples.
struct NoiseDistance {
  double signal_dn = 0;  ///< centre of the level; the mean clean signal for the pooled one
  double bin_width_dn = 0;
  std::int64_t reference_samples = 0, test_samples = 0;
  double kld_nats = 0;  ///< D(test || reference)
  double jsd_bits = 0;  ///< base 2, 0..1
  double sqrt_jsd = 0;
  /// On average of two samples of one distribution of these sizes, whose rows and frames' levels
  /// scatter as these do (of compare_scenes: of independent pixels). Of one frame slow drift of the
  /// rows is not seen.
  double sqrt_jsd_floor = 0;
};

/// Structure of one set's noise.
struct NoiseStructure {
  std::vector<double> mean_dn;    ///< per channel
  std::vector<double> sd_dn;      ///< per channel, all noise together
  std::vector<double> row_sd_dn;  ///< per channel: rows' offsets beyond what pixel noise explains
  std::vector<double> column_sd_dn;  ///< per channel
  /// Power of the mosaic rows' means in kRowBands equal bands of frequency, low to high, DN²;
  /// channel means removed, pixel noise included. White rows: equal powers, each the variance of
  /// the means. Empty for frames with too few rows, or with rows without a finite pixel.
  std::vector<double> row_power_dn2;
  /// Correlation of mosaic neighbours, channels scaled to one variance; lags 1, 2, ... kLags.
  std::vector<double> along_row, along_column;
  /// Correlation of a pixel in a frame and in the next, about its channel's mean: the share of the
  /// variance that all frames have in common (shading, a fixed pattern), or a camera's temporal
  /// filter; 0 for one frame. Removing the mean of n frames leaves -1/(n - 1).
  double between_frames = 0;
};
inline constexpr int kLags = 4;
inline constexpr int kRowBands = 8;

struct NoiseComparison {
  NoiseDistance pooled;
  std::vector<NoiseDistance> levels;  ///< those with kEnoughSamples on both sides; rising signal
  int levels_left_out = 0;
  NoiseStructure reference, test;  ///< of the frames as they are
  /// Step of the other side's codes [DN], to which this side's frames were rounded for the
  /// divergences; 0: they are as they were. Beside codes, noise that was never rounded would differ
  /// by what the converter's step hides, which says nothing of the noise.
  double reference_rounded_dn = 0, test_rounded_dn = 0;
  /// How many times the clean scene's light each side's first frame shows (light_over_clean); empty
  /// where there is no such scene, or the noise hides it.
  std::optional<double> reference_light, test_light;
};
inline constexpr std::int64_t kEnoughSamples = 1000;

/// Noise is frame minus clean. clean_dn: the scene without noise in DN above black, or none for
/// frames of a uniform scene (dark, flat), whose values are compared as they are, biases included,
/// and pooled only.
/// Levels divide the clean signal evenly between its 0.5 and 99.5 percentiles. Bins divide +-6
/// standard deviations of a level's reference noise (and the test's, if larger) evenly;
/// frames of codes get bins of whole steps, and frames that are none, or of a finer step, are
/// rounded to the other side's codes first, pixel by pixel. Where the fixed pattern is removed, the
/// divergences are of frames less the mean of as many in a row as the smaller set has, which is
/// their level without clean_dn; the structure is of frames less their set's mean. Samples beyond
/// go to the outermost bins; pixels that are not finite are left out. Throws InputError when sizes
/// differ, a set is empty, remove_fixed_pattern has fewer than two frames, or a setting is out of
/// its range.
NoiseComparison compare_noise(const NoiseFrames& reference, const NoiseFrames& test,
                              const std::optional<Image>& clean_dn, const SensorLayout& layout,
                              const NoiseComparisonSettings& settings,
                              Progress& progress = silent_progress());

std::vector<Quantity> quantities_of(const NoiseComparison& comparison);

/// The noise of one scene in two ways, DN; of any sizes.
struct NoiseOfScene {
  Image reference, test;
};
/// Distance of all scenes' noise in one histogram each, whose floor falls with their number: of
/// equal bins over +-6 standard deviations of all. Every scene is loaded twice. Samples that are
/// not finite are left out. signal_dn is NaN. Undecided where either side has fewer than two.
Estimate<NoiseDistance> compare_scenes(int scenes, const std::function<NoiseOfScene(int)>& load,
                                       int bins);

/// The uniform scene that frames show, for frames without noise in its place: the channels' means
/// less those of as many frames without light, for one frame's mean has its row noise and the
/// lamp's flicker. A channel that is lit by less than a twentieth of the noise without light counts
/// as dark, 0. All DN above black; pixels that are not finite are left out. Result: of the size of
/// the frames without light. Frames beyond the smaller set's count and beyond kMostSceneFrames are
/// not loaded. Contract: neither set is empty.
Image uniform_scene(const NoiseFrames& lit, const NoiseFrames& unlit, const SensorLayout& layout);
inline constexpr int kMostSceneFrames = 16;

/// What of a picture is left where noise averages out: PSNR in dB of noisy frames' mean, less the
/// channels' biases, against the clean mosaic. peak_dn: white above black. All DN above black;
/// pixels that are not finite are left out. Undecided without a finite pixel. Contract: equal
/// sizes, one bias per channel.
Estimate<double> kept_detail_psnr_db(View<const float> mean_dn, View<const float> clean_dn,
                                     const SensorLayout& layout, const std::vector<double>& bias_dn,
                                     double peak_dn);

}  // namespace malus
