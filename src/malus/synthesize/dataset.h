// Synthetic training pairs in any number: sample i is a function of the settings, the seed and i
// alone, so any number of workers makes the same data set, and a broken run goes on where it was.
#pragma once

#include "malus/base/parameter.h"
#include "malus/polar/symmetry.h"
#include "malus/synthesize/synthesizer.h"

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

namespace malus {

struct DatasetSettings {
  int samples = 1000, shard_size = 256, patch = 256;
  std::vector<double> ratios = {10, 60};
  std::vector<double> gains;
  bool symmetries = true;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    const double infinity = std::numeric_limits<double>::infinity();
    field(self.samples, ParameterInfo{"samples", "1", "number of pairs", 1, 2e9});
    field(self.shard_size, ParameterInfo{"shard_size", "1", "pairs in one file", 1, 1e6});
    field(self.patch,
          ParameterInfo{"patch", "px", "side of a square patch of the mosaic", 8, 16384});
    field(self.ratios, ParameterInfo{"ratios", "1", "low-light ratios, one drawn for every pair",
                                     kLeastRatio, kMostRatio});
    field(self.gains, ParameterInfo{"gains", "",
                                    "gains in the model's unit, one drawn for every "
                                    "pair; empty: random in log K over the "
                                    "calibrated range",
                                    -infinity, infinity});
    field(self.symmetries, ParameterInfo{"symmetries", "",
                                         "turn and mirror patches the ways that "
                                         "keep the mosaic's layout"});
  }
};

/// How one sample is made.
struct SampleRecipe {
  std::uint32_t number = 0;
  std::size_t source = 0;
  int row0 = 0, col0 = 0;  ///< of the patch in the source, whole cells and row groups
  Symmetry symmetry = Symmetry::kIdentity;
  double ratio = 1;
  std::optional<double> gain;  ///< empty: random
};

/// Throws InputError, naming the source, where no patch fits into its rows x cols pixels.
void require_room(const std::string& source, int rows, int cols, const DatasetSettings& settings,
                  const SensorLayout& layout);

/// Throws InputError that names the source where a pixel is NaN or infinite: no network could be
/// trained with it.
void require_finite(const Image& image, const std::string& source);

/// Throws InputError where a patch is not made of whole cells and row groups.
void require_patch_of_cells(const DatasetSettings& settings, const SensorLayout& layout,
                            int row_group);

/// sizes: {rows, cols} of the clean sources. Throws InputError as require_patch_of_cells, and as
/// require_room.
SampleRecipe sample_recipe(const DatasetSettings& settings, const SensorLayout& layout,
                           int row_group, const std::vector<std::pair<int, int>>& sizes,
                           std::uint64_t seed, std::uint32_t number);

struct TrainingPair {
  Image clean_dn, noisy_dn;  ///< mosaics of settings.patch, DN above black
  GainSetting gain;
  /// What debias took from every pixel before the amplification (FrameParameters::global_bias_dn).
  double removed_bias_dn = 0;
  LevelCoverage coverage;  ///< of kind nonparametric; else empty
};

/// The recipe's patch of a clean source, cut and turned: geometry comes before the noise, or rows
/// would become columns.
Image clean_patch_of(const SampleRecipe& recipe, const DatasetSettings& settings,
                     View<const float> source_dn, const SensorLayout& layout);

/// Adds noise to the recipe's clean patch. synthesizer: with the recipe's ratio in its settings;
/// where these do not amplify, the clean patch is divided by the ratio, so that the two can be
/// compared.
TrainingPair make_pair_of(const SampleRecipe& recipe, const DatasetSettings& settings,
                          View<const float> source_dn, const Synthesizer& synthesizer,
                          const std::optional<GainSetting>& gain, std::uint64_t seed);

}  // namespace malus
