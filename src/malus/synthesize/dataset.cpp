#include "malus/synthesize/dataset.h"

#include "malus/base/error.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/base/text.h"
#include "malus/image/window.h"

#include <algorithm>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

// Symmetries that the mosaic itself allows, with their shifts.
std::vector<Symmetry> allowed_symmetries(const SensorLayout& layout) {
  std::vector<Symmetry> allowed;
  for (const SymmetryFacts& facts : kSymmetries)
    if (lattice_shift(layout, facts.symmetry)) allowed.push_back(facts.symmetry);
  return allowed;
}

// Side of what is cut out: the patch, and one cell for the shift of a turned mosaic.
int side_of_cut(const DatasetSettings& settings, const SensorLayout& layout) {
  return settings.patch + (settings.symmetries ? std::max(layout.rows(), layout.cols()) : 0);
}

}  // namespace

void require_room(const std::string& source, int rows, int cols, const DatasetSettings& settings,
                  const SensorLayout& layout) {
  const int side = side_of_cut(settings, layout);
  if (rows < side || cols < side)
    throw InputError(
        source,
        fmt::format("has {} x {} pixels and holds no patch of {}{}", cols, rows, settings.patch,
                    settings.symmetries ? " and the cell that turning it needs" : ""),
        "use larger pictures or a smaller patch");
}

void require_finite(const Image& image, const std::string& source) {
  const auto odd = std::count_if(image.values().begin(), image.values().end(),
                                 [](float value) { return !std::isfinite(value); });
  if (odd > 0)
    throw InputError(source, counted_are(odd, "pixel") + " NaN or infinite",
                     "networks cannot be trained with them: mend or leave out the picture");
}

void require_patch_of_cells(const DatasetSettings& settings, const SensorLayout& layout,
                            int row_group) {
  const int step = std::lcm(std::lcm(layout.rows(), row_group), layout.cols());
  if (settings.patch % step == 0) return;
  throw InputError(fmt::format("patch = {}", settings.patch),
                   fmt::format("is not made of whole cells of {} x {} and row groups of {}",
                               layout.rows(), layout.cols(), row_group),
                   fmt::format("use a multiple of {}", step));
}

SampleRecipe sample_recipe(const DatasetSettings& settings, const SensorLayout& layout,
                           int row_group, const std::vector<std::pair<int, int>>& sizes,
                           std::uint64_t seed, std::uint32_t number) {
  require_patch_of_cells(settings, layout, row_group);
  MALUS_REQUIRE(!sizes.empty() && !settings.ratios.empty());
  const int step_rows = std::lcm(layout.rows(), row_group), step_cols = layout.cols();
  RandomSequence random(seed, number, Draw::kScene, kStreamSample);
  SampleRecipe recipe;
  recipe.number = number;
  recipe.source = pick(random, sizes.size());
  const auto [rows, cols] = sizes[recipe.source];
  require_room(fmt::format("clean source {}", recipe.source), rows, cols, settings, layout);
  const int side = side_of_cut(settings, layout);
  recipe.row0 = step_rows * static_cast<int>(pick(
                                random, static_cast<std::size_t>((rows - side) / step_rows + 1)));
  recipe.col0 = step_cols * static_cast<int>(pick(
                                random, static_cast<std::size_t>((cols - side) / step_cols + 1)));
  const auto symmetries = allowed_symmetries(layout);
  const std::size_t turn = pick(random, symmetries.size());
  if (settings.symmetries) recipe.symmetry = symmetries[turn];
  recipe.ratio = settings.ratios[pick(random, settings.ratios.size())];
  if (!settings.gains.empty()) recipe.gain = settings.gains[pick(random, settings.gains.size())];
  return recipe;
}

Image clean_patch_of(const SampleRecipe& recipe, const DatasetSettings& settings,
                     View<const float> source_dn, const SensorLayout& layout) {
  const int side = side_of_cut(settings, layout);
  const Image turned =
      moved(source_dn.window(recipe.row0, recipe.col0, side, side), recipe.symmetry);
  const auto shift = lattice_shift(layout, recipe.symmetry);
  MALUS_REQUIRE(shift.has_value());
  return part_of(turned, {shift->rows, shift->cols, settings.patch, settings.patch});
}

TrainingPair make_pair_of(const SampleRecipe& recipe, const DatasetSettings& settings,
                          View<const float> source_dn, const Synthesizer& synthesizer,
                          const std::optional<GainSetting>& gain, std::uint64_t seed) {
  TrainingPair pair;
  pair.clean_dn = clean_patch_of(recipe, settings, source_dn, synthesizer.model().layout);
  SyntheticFrame noisy =
      synthesizer.draw(pair.clean_dn, gain,
                       synthesizer.somewhere(settings.patch, settings.patch, seed, recipe.number));
  pair.noisy_dn = std::move(noisy.dn);
  pair.gain = noisy.gain;
  pair.removed_bias_dn = noisy.global_bias_dn;
  pair.coverage = noisy.coverage;
  const float factor =
      synthesizer.settings().amplify ? 1.0f : static_cast<float>(1.0 / recipe.ratio);
  for (float& v : pair.clean_dn.values()) v *= factor;
  return pair;
}

}  // namespace malus
