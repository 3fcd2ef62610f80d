// Non-parametric noise (001, Eq. 3 and S2): per signal level a histogram of noisy - clean, drawn
// exactly by Walker's alias method ("An efficient method for generating discrete random variables
// with general distributions", ACM TOMS 3, 1977) and uniform inside the bin. Between two levels one
// of them is chosen at random with the fractional distance as probability, so that mean and second
// moment interpolate linearly in the signal, as shot noise does. Below the first level that one
// serves, above the last one its distribution, widened where K is known (noise/level_noise.h).
#pragma once

#include "malus/image/view.h"
#include "malus/noise/calibration.h"
#include "malus/synthesize/exact.h"
#include "malus/synthesize/level_tables.h"

#include <cstdint>
#include <vector>

namespace malus {

/// Noise at one signal level on bins of its own.
struct LevelDistribution {
  double level_dn = 0;
  std::vector<double> bin_edges_dn;  ///< rising, of noisy - clean
  std::vector<double> pmf;
};

/// Whole numbers that both a calibration's frames and a sampler's output are rounded to. The
/// rounding's variance, q²/12, is taken out by drawing the distributions narrower about their
/// means; that of signal zero does not hold it (noise/level_noise.h).
struct LevelRounding {
  double step_dn = 0;  ///< 0: output is not rounded
};

class LevelSampler {
 public:
  /// Contract: one channel of the calibration per channel of the layout, as models are checked.
  /// row_group 0: no row noise. highest_dn: brightest signal that noise has to grow for.
  LevelSampler(const SensorLayout& layout, const NonparametricCalibration& calibration,
               int row_group, double highest_dn = 0.0, LevelRounding rounding = {});
  /// Per channel its levels, rising, all with equally many bins; sigma_row_dn: one per channel or
  /// empty; row_drift: of the rows.
  LevelSampler(const SensorLayout& layout,
               const std::vector<std::vector<LevelDistribution>>& channels,
               const std::vector<double>& sigma_row_dn, int row_group, const RowDrift& row_drift);

  /// DN above black in and out, in place if wanted; as CompiledNoise::apply.
  void apply(View<const float> clean_dn, View<float> noisy_dn, const DrawAddress& address) const {
    apply(clean_dn, clean_dn, noisy_dn, address);
  }
  /// out = base + noise at the level of `signal`.
  void apply(View<const float> signal_dn, View<const float> base_dn, View<float> out_dn,
             const DrawAddress& address) const;

 private:
  /// Numbers of one channel and where its tables start.
  struct Channel {
    float guess_start_dn = 0, guesses_per_dn = 0, sigma_row_dn = 0;
    std::uint32_t first_guess = 0, first_span = 0, last_span = 0;
    std::uint32_t bins = 0, first_cell = 0, first_place = 0, places_per_level = 0;
  };
  struct RowLanes;
  void add_channel(const std::vector<double>& level_dn, std::size_t bins, bool shared_places,
                   double sigma_row_dn);
  void add_calibrated(const NonparametricChannel& measured, double gain_dn_per_e,
                      double sigma_row_dn, double highest_dn, LevelRounding rounding);
  void add_places(const std::vector<double>& edges_dn);
  void add_cells(const std::vector<double>& pmf);
  std::vector<RowLanes> row_lanes() const;

  SensorLayout layout_;
  std::vector<Channel> channels_;
  std::vector<std::uint32_t> guess_;
  std::vector<LevelSpan> spans_;
  std::vector<AliasCell> cells_;
  std::vector<BinPlace> places_;
  int row_group_ = 0;
  RowDrift row_drift_;
};

/// Walker's tables of bin probabilities (non-negative, any sum above 0); thresholds in 2^-24.
std::vector<AliasCell> alias_cells(const std::vector<double>& probabilities);

}  // namespace malus
