// Histograms of noisy - clean per channel and signal level (001, S1-S2).
#pragma once

#include "malus/noise/calibration.h"

#include <cstddef>
#include <cstdint>
#include <string>
#include <utility>
#include <vector>

namespace malus {

/// Where an integer converter's codes lie on the axis of noisy - clean in the dark: at
/// offset + k * step. step 0: no converter.
struct CodeGrid {
  double step_dn = 0, offset_dn = 0;
};

/// Bin edges about a centre (the dark bias): equal and at most a sixth of the smallest deviation
/// wide within seven of it, where dark levels need them, then wider by a constant factor out to
/// seven of the largest deviation. On an integer converter edges lie between codes (narrow bins
/// divide a code evenly), so that uniform draws inside a bin fall on its codes again. About `bins`
/// bins; where the codes near the centre would take more than two thirds of them, codes are merged.
std::vector<double> noise_bin_edges(double smallest_sd_dn, double largest_sd_dn, int bins,
                                    double centre_dn = 0.0, CodeGrid codes = {});

/// What lies behind a histogram of codes: the noise before the converter rounds it, in equal parts
/// of each code, without normal row noise.
struct DarkDensity {
  std::vector<double> probability;  ///< `parts` of one code after those of the code before
  int parts = 1;                    ///< of a code: more where the noise is narrow against it
  std::size_t codes_below = 0;      ///< before the first that was counted
};
/// The distribution that, plus row noise, rounded, gives the observed one: exactly so where there
/// is no row noise, else by Richardson, JOSA 62, 1972, and Lucy, Astron. J. 79, 1974. Smooth inside
/// the codes: at the codes' boundaries the cumulative one is known, and between them its normal
/// quantile is taken for a line, as it is of normal noise. counts: one per code, neighbours
/// adjacent; the result adds to one. is_cut_off: the first code stands for all that is below it.
/// Then the result goes on below, as far as row noise brings anything up from there, and gives the
/// observed one when all that ends below the first code is counted in it.
DarkDensity without_row_noise(const std::vector<double>& counts, double step_dn,
                              double sigma_row_dn, bool is_cut_off = false);

/// Moments of the noise at one level, of its own samples alone.
struct LevelNoise {
  double signal_dn = 0, variance_dn2 = 0;
  double freedom = 0;  ///< independent samples' worth: Var(s²) = 2 σ⁴ / freedom for normal noise
};

/// One channel's histograms, by level = nearest multiple of the step.
class LevelHistograms {
 public:
  LevelHistograms() = default;
  LevelHistograms(std::vector<double> edges_dn, double step_dn, double range_dn);

  /// Signals outside 0..range count at the nearest level; noise outside the edges counts in the
  /// last bins, whose edges move out to hold it.
  void add(double signal_dn, double noise_dn);
  /// A residual of mean zero and an unbiased estimate of its variance, for noise(); freedom: what
  /// it counts for.
  void add_square(double signal_dn, double residual_dn, double square_dn2, double freedom);
  /// The distribution in the dark before it is rounded, uniform inside equal parts of codes:
  /// probability i at offset + i * step. It becomes the level of signal zero.
  void set_dark(const std::vector<double>& probability, CodeGrid codes, std::int64_t samples);

  struct Result {
    NonparametricChannel channel;
    /// Level and its samples, neighbours' included: too few.
    std::vector<std::pair<double, std::int64_t>> refused;
  };
  /// Levels with at least wanted samples as they are; those with fewer borrow from up to two levels
  /// on both sides, and are refused when that does not give a tenth of what is wanted. A level's
  /// centre is the mean signal of its samples, borrowed ones included.
  Result result(std::int64_t wanted) const;
  /// Of all levels with two squares or more, rising.
  std::vector<LevelNoise> noise() const;

 private:
  struct Level {
    std::int64_t count = 0;
    double signal_sum = 0;
  };
  struct Squares {
    double signal_sum = 0, residual_sum = 0, square_sum = 0, freedom = 0;
    std::int64_t count = 0;
  };
  std::size_t level_of(double signal_dn) const;
  /// Of the two bins whose middles are around it, the farther one for shares (0 to 1) below its
  /// part.
  std::ptrdiff_t bin_of(double noise_dn, double share) const;
  std::vector<double> edges_;
  std::vector<Level> levels_;
  std::vector<Squares> squares_;       ///< [level]
  std::vector<std::uint32_t> counts_;  ///< [level][bin]
  std::vector<double> dark_pmf_;       ///< by bin; empty: none set
  std::int64_t dark_samples_ = 0;
  double step_dn_ = 1, lowest_ = 0, highest_ = 0;
};

}  // namespace malus
