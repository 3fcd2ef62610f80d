#include "malus/denoise/internal/quiet_patches.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/denoise/internal/quiet_directions.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>

namespace malus {
namespace {

constexpr int kQuietSide = 6, kQuietPixels = kQuietSide * kQuietSide;
// Side of the squares whose patches choose directions and are measured in turns.
constexpr int kQuietHalfUnits = 16;
constexpr std::size_t kQuietPerLevel = 1500, kMostQuietLevels = 8, kLeastQuiet = 300;
constexpr std::size_t kLeastOfHalf = 40;
constexpr std::ptrdiff_t kMostQuietPatches = 25000;  // of one phase
constexpr double kKeptShares[] = {1.0, 0.5, 0.25, 0.12, 0.06, 0.03};
constexpr int kConcentrations = 2;
constexpr double kUneven = 0.2;  // of the brightness
// Patches overlap: what each tells of its own is worth this many cells of its pixels.
constexpr double kOwnOfUnit = 2.0;
constexpr double kQuietClearly = 2.0;  // standard errors

struct QuietPatch {
  int row, col;
  bool second;                // which squares' it is
  float mean = 0, noise = 0;  // of the half that is seen
  float distance = 0;
};

// What is seen of the patches that begin at one phase of the cell, by one half of their pixels.
class HalfView {
 public:
  HalfView(View<const float> dn, std::vector<int> seen, std::vector<int> hidden)
      : dn_(dn), seen_(std::move(seen)), hidden_(std::move(hidden)) {}

  float at(const QuietPatch& p, int pixel) const {
    return dn_(p.row + pixel / kQuietSide, p.col + pixel % kQuietSide);
  }
  float mean(const QuietPatch& p) const {
    float sum = 0;
    for (const int i : seen_) sum += at(p, i);
    return sum / static_cast<float>(seen_.size());
  }
  double mean(const std::vector<double>& pattern) const {
    double sum = 0;
    for (const int i : seen_) sum += pattern[static_cast<std::size_t>(i)];
    return sum / static_cast<double>(seen_.size());
  }
  // How far the half is from the pattern at the patch's own brightness, in deviations.
  float distance(const QuietPatch& p, const std::vector<double>& pattern,
                 const std::vector<double>& weight) const {
    double product = 0, square = 0, own = 0;
    for (const int i : seen_) {
      const auto k = static_cast<std::size_t>(i);
      const double v = at(p, i);
      product += weight[k] * v * pattern[k];
      square += weight[k] * pattern[k] * pattern[k];
      own += weight[k] * v * v;
    }
    return static_cast<float>(own - (square > 0 ? product * product / square : 0));
  }
  const std::vector<int>& hidden() const { return hidden_; }

 private:
  View<const float> dn_;
  std::vector<int> seen_, hidden_;
};

std::vector<double> mean_of(const HalfView& view, std::span<const QuietPatch> patches) {
  std::vector<double> pattern(kQuietPixels);
  for (const QuietPatch& p : patches)
    for (int i = 0; i < kQuietPixels; ++i)
      pattern[static_cast<std::size_t>(i)] += view.at(p, i) / static_cast<double>(patches.size());
  return pattern;
}

std::vector<double> median_of_pixels(const HalfView& view, std::span<const QuietPatch> patches) {
  std::vector<double> pattern;
  for (int i = 0; i < kQuietPixels; ++i) {
    std::vector<double> values;
    for (const QuietPatch& p : patches) values.push_back(view.at(p, i));
    pattern.push_back(median_of(std::move(values)));
  }
  return pattern;
}

// The channels of the pixels of patches of one phase, and what their noise is thought to be.
struct PatchCamera {
  std::vector<std::size_t> channel;
  const std::vector<VarianceCurve>& variance;
  const std::vector<double>& dark_dn;
  double own_share;  // of a patch's noise that no other patch of the phase shows

  std::vector<double> weights(const std::vector<double>& pattern) const {
    std::vector<double> weight;
    for (std::size_t i = 0; i < pattern.size(); ++i)
      weight.push_back(1.0 / std::max(variance[channel[i]](pattern[i]), 1e-30));
    return weight;
  }
  // Mean over the channels: of patches of other brightness against each other.
  double noise_at(double signal_dn) const {
    return std::max(mean_variance_dn2(variance, signal_dn), 1e-30);
  }
  bool dark(const std::vector<double>& pattern) const {
    for (std::size_t i = 0; i < pattern.size(); ++i)
      if (!dark_dn.empty() && pattern[i] < dark_dn[channel[i]]) return true;
    return false;
  }
};

// NaN of channels that a patch is too small to hold.
std::vector<double> signals_of_channels(const PatchCamera& camera,
                                        const std::vector<double>& pattern) {
  std::vector<double> signal(camera.variance.size()), count(signal);
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    signal[camera.channel[i]] += pattern[i];
    ++count[camera.channel[i]];
  }
  for (std::size_t k = 0; k < signal.size(); ++k) signal[k] /= count[k];
  return signal;
}

// Of one brightness all over, but for what changes the noise by no more than a quarter.
bool even(const PatchCamera& camera, const std::vector<double>& pattern) {
  const std::vector<double> signal = signals_of_channels(camera, pattern);
  for (std::size_t i = 0; i < pattern.size(); ++i) {
    const double mean = signal[camera.channel[i]];
    if (std::abs(pattern[i] - mean) >
        std::max(kUneven * std::abs(mean), std::sqrt(camera.variance[camera.channel[i]](mean))))
      return false;
  }
  return true;
}

// The hidden half in deviations, without its mean.
internal::PatchMatrix hidden_half(const HalfView& view, const PatchCamera& camera,
                                  std::span<const QuietPatch> patches,
                                  const std::vector<double>& pattern, bool second) {
  const std::vector<double> weight = camera.weights(pattern);
  const double noise = camera.noise_at(view.mean(pattern));
  internal::PatchMatrix half(std::ssize(patches), std::ssize(view.hidden()));
  Eigen::Index row = 0;
  for (const QuietPatch& p : patches) {
    if (p.second != second) continue;
    const double brighter = noise / static_cast<double>(p.noise);
    Eigen::Index col = 0;
    for (const int i : view.hidden()) {
      const auto k = static_cast<std::size_t>(i);
      half(row, col++) =
          static_cast<float>((view.at(p, i) - pattern[k]) * std::sqrt(weight[k] * brighter));
    }
    ++row;
  }
  half.conservativeResize(row, Eigen::NoChange);
  if (row > 0) half.rowwise() -= half.colwise().mean().eval();
  return half;
}

// NaN where there are too few patches.
double hidden_variance(const HalfView& view, const PatchCamera& camera,
                       std::span<const QuietPatch> patches, const std::vector<double>& pattern) {
  const internal::PatchMatrix first = hidden_half(view, camera, patches, pattern, false),
                              second = hidden_half(view, camera, patches, pattern, true);
  if (std::min(first.rows(), second.rows()) < static_cast<Eigen::Index>(kLeastOfHalf))
    return std::numeric_limits<double>::quiet_NaN();
  return internal::quietest_variance(first, second);
}

// Of one level, by one half of the pixels. level: is put in another order.
QuietPatches quiet_of_level(const HalfView& view, const PatchCamera& camera,
                            std::span<QuietPatch> level) {
  QuietPatches quiet;
  quiet.ratio = std::numeric_limits<double>::infinity();
  std::vector<double> pattern = median_of_pixels(view, level);
  for (const double share : kKeptShares) {
    const auto kept = static_cast<std::size_t>(share * static_cast<double>(level.size()));
    if (kept < 2 * kLeastOfHalf) break;
    for (int pass = 0; pass < kConcentrations; ++pass) {
      const std::vector<double> weight = camera.weights(pattern);
      for (QuietPatch& p : level) p.distance = view.distance(p, pattern, weight) / p.noise;
      std::nth_element(
          level.begin(), level.begin() + static_cast<std::ptrdiff_t>(kept) - 1, level.end(),
          [](const QuietPatch& a, const QuietPatch& b) { return a.distance < b.distance; });
      pattern = mean_of(view, level.first(kept));
    }
    if (camera.dark(pattern)) break;
    if (!even(camera, pattern)) continue;
    const double ratio = hidden_variance(view, camera, level.first(kept), pattern),
                 error = internal::quietest_error(static_cast<double>(kept) * camera.own_share);
    if (ratio * (1 + kQuietClearly * error) < quiet.ratio)
      quiet = {signals_of_channels(camera, pattern), ratio, error};
  }
  return quiet;
}

// Patches from all over the frame, of both kinds of squares alike.
std::vector<QuietPatch> patches_at(View<const float> dn, const SensorLayout& layout, int row0,
                                   int col0, const std::vector<float>& saturated_dn) {
  const int unit_rows = std::max(layout.rows(), 2), unit_cols = std::max(layout.cols(), 2);
  const int down = (dn.rows() - row0 - kQuietSide) / unit_rows + 1,
            across = (dn.cols() - col0 - kQuietSide) / unit_cols + 1;
  const int reach_down = (kQuietSide - 1) / unit_rows, reach_across = (kQuietSide - 1) / unit_cols;
  const std::ptrdiff_t apart =
      (std::ptrdiff_t{down} * across + kMostQuietPatches - 1) / kMostQuietPatches;
  const int pairs_across = across / (2 * kQuietHalfUnits) + 1;
  std::vector<QuietPatch> patches;
  for (int i = 0; i < down; ++i)
    for (int k = 0; k < across; ++k) {
      const std::ptrdiff_t pair =
          std::ptrdiff_t{i / kQuietHalfUnits} * pairs_across + k / (2 * kQuietHalfUnits);
      // A patch that lies in two squares would be in neither's noise alone.
      if (pair % apart != 0 || i % kQuietHalfUnits + reach_down >= kQuietHalfUnits ||
          k % kQuietHalfUnits + reach_across >= kQuietHalfUnits)
        continue;
      QuietPatch p{row0 + i * unit_rows, col0 + k * unit_cols,
                   (i / kQuietHalfUnits + k / kQuietHalfUnits) % 2 != 0};
      bool whole = true;
      for (int r = p.row; r < p.row + kQuietSide; ++r)
        for (int c = p.col; c < p.col + kQuietSide; ++c)
          whole = whole && std::isfinite(dn(r, c)) &&
                  dn(r, c) < saturated_dn[static_cast<std::size_t>(layout.channel_at(r, c))];
      if (whole) patches.push_back(p);
    }
  return patches;
}

// Both halves of a cell of two by two hold all of its channels, those of larger cells all colours.
bool in_first_half(const SensorLayout& layout, int row, int col) {
  const bool blocks = layout.rows() == 2 && layout.cols() == 2;
  return (blocks ? row / 2 + col / 2 : row + col) % 2 == 0;
}

HalfView view_of(View<const float> dn, const SensorLayout& layout, bool first) {
  std::vector<int> seen, hidden;
  for (int i = 0; i < kQuietPixels; ++i)
    (in_first_half(layout, i / kQuietSide, i % kQuietSide) == first ? seen : hidden).push_back(i);
  return HalfView(dn, std::move(seen), std::move(hidden));
}

struct PhaseOfCell {
  int row, col;
  bool first;  // which half of the pixels is seen
};

std::vector<PhaseOfCell> phases_of(const SensorLayout& layout) {
  std::vector<PhaseOfCell> phases;
  for (int row = 0; row < std::max(layout.rows(), 2); row += 2)
    for (int col = 0; col < std::max(layout.cols(), 2); col += 2)
      for (const bool first : {true, false}) phases.push_back({row, col, first});
  return phases;
}

PatchCamera camera_at(const SensorLayout& layout, const PhaseOfCell& phase,
                      const std::vector<VarianceCurve>& variance,
                      const std::vector<double>& dark_dn) {
  const int unit = std::max(layout.rows(), 2) * std::max(layout.cols(), 2);
  PatchCamera camera{{}, variance, dark_dn, std::min(kOwnOfUnit * unit / kQuietPixels, 1.0)};
  for (int i = 0; i < kQuietPixels; ++i)
    camera.channel.push_back(static_cast<std::size_t>(
        layout.channel_at(phase.row + i / kQuietSide, phase.col + i % kQuietSide)));
  return camera;
}

// By the brightness of the half that is seen. patches: are put in another order.
std::vector<QuietPatches> levels_of_phase(const HalfView& view, const PatchCamera& camera,
                                          std::span<QuietPatch> patches, std::size_t levels) {
  for (QuietPatch& patch : patches) {
    patch.mean = view.mean(patch);
    patch.noise = static_cast<float>(camera.noise_at(patch.mean));
  }
  std::sort(patches.begin(), patches.end(),
            [](const QuietPatch& a, const QuietPatch& b) { return a.mean < b.mean; });
  std::vector<QuietPatches> found;
  for (std::size_t i = 0; i < levels; ++i) {
    const std::size_t begin = i * patches.size() / levels, end = (i + 1) * patches.size() / levels;
    found.push_back(quiet_of_level(view, camera, patches.subspan(begin, end - begin)));
  }
  return found;
}

// Of the phases; levels that some phase has nothing quiet at are left out. Of a large cell a
// phase's patches do not hold all channels: those signals are the other phases'.
std::vector<QuietPatches> mean_of_phases(const std::vector<std::vector<QuietPatches>>& found,
                                         std::size_t channels) {
  const double share = 1.0 / static_cast<double>(found.size());
  std::vector<QuietPatches> result;
  for (std::size_t i = 0; i < found.front().size(); ++i) {
    QuietPatches level{std::vector<double>(channels), 0, 0};
    std::vector<double> untold(channels);
    for (const std::vector<QuietPatches>& of_phase : found) {
      level.ratio += share * of_phase[i].ratio;
      level.relative_error += share * std::sqrt(share) * of_phase[i].relative_error;
      for (std::size_t k = 0; k < of_phase[i].signal_dn.size(); ++k)
        if (std::isnan(of_phase[i].signal_dn[k]))
          untold[k] += share;
        else
          level.signal_dn[k] += share * of_phase[i].signal_dn[k];
    }
    for (std::size_t k = 0; k < channels; ++k)
      if (untold[k] > 0) level.signal_dn[k] /= 1 - untold[k];
    if (std::isfinite(level.ratio)) result.push_back(std::move(level));
  }
  return result;
}

}  // namespace

std::vector<QuietPatches> quiet_patches(View<const float> dn, const SensorLayout& layout,
                                        const std::vector<VarianceCurve>& variance,
                                        const std::vector<float>& saturated_dn,
                                        const std::vector<double>& dark_dn) {
  MALUS_REQUIRE(std::ssize(saturated_dn) == layout.channels() &&
                variance.size() == saturated_dn.size());
  const std::vector<PhaseOfCell> phases = phases_of(layout);
  std::vector<std::vector<QuietPatch>> patches;
  std::size_t least = std::numeric_limits<std::size_t>::max();
  for (const PhaseOfCell& phase : phases) {
    patches.push_back(patches_at(dn, layout, phase.row, phase.col, saturated_dn));
    least = std::min(least, patches.back().size());
  }
  if (least < kLeastQuiet) return {};
  const std::size_t levels = std::clamp<std::size_t>(least / kQuietPerLevel, 1, kMostQuietLevels);
  std::vector<std::vector<QuietPatches>> found(phases.size());
  parallel_for(0, std::ssize(phases), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto p = static_cast<std::size_t>(begin); p < static_cast<std::size_t>(end); ++p)
      found[p] =
          levels_of_phase(view_of(dn, layout, phases[p].first),
                          camera_at(layout, phases[p], variance, dark_dn), patches[p], levels);
  });
  return mean_of_phases(found, variance.size());
}

}  // namespace malus
