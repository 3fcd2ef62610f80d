#include "malus/denoise/internal/noise_floor.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/denoise/internal/quiet_directions.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <utility>

namespace malus {
namespace {

constexpr int kSide = 6, kPixels = kSide * kSide;  // of a patch
constexpr int kMargin = 3;                         // units around a patch that are its surroundings
constexpr int kEvenMargin = 8;                     // pixels around a patch that must be as bright
constexpr double kUnevenSignal = 0.25;             // of the brightness
constexpr int kHalfUnits = 16;      // side of the squares that the halves take in turns
constexpr int kTileUnits = 64;      // a tile's side at most
constexpr int kMostTiles = 9;       // of a large frame, spread evenly
constexpr int kLeastPatches = 300;  // a half has four times its directions
constexpr std::size_t kPatchesPerLevel = 3000, kMostFloors = 8;
constexpr double kShares[] = {1.0, 0.4, 0.2}, kClearly = 2.0;  // standard errors
// Slanted stripes are as rough and as bright around all patches, but for a hundredth that goes by
// where in the patch they lie. Told apart by it, patches would have the same dark pixels, and the
// least noise of these for that of all.
constexpr double kSmoother = 0.9;   // of the usual roughness
constexpr double kBrighter = 0.05;  // of the brightness, from level to level

using internal::PatchMatrix;

// What patches step by: the cell, or two pixels of layouts with a smaller one.
struct Unit {
  int rows, cols;
};

Unit unit_of(const SensorLayout& layout) {
  return {std::max(layout.rows(), 2), std::max(layout.cols(), 2)};
}

struct Patch {
  std::array<float, kPixels> values;  // in deviations
  float roughness = 0;                // of the surroundings
  float signal = 0;                   // theirs
  bool second_half = false;
};

// A part of the frame, normalised. Values are NaN where a pixel does not count.
struct Tile {
  int row0, col0, units_down, units_across;
  Image normal;
  // Per unit; sums over their pixels, and how many units count.
  std::vector<double> roughness, signal, counts;
};

struct Frame {
  View<const float> dn;
  const SensorLayout& layout;
  const std::vector<VarianceCurve>& variance;
  const std::vector<float>& saturated_dn;
  const std::vector<double>& dark_dn;

  std::size_t channel_at(int row, int col) const {
    return static_cast<std::size_t>(layout.channel_at(row, col));
  }
  bool counts(float v, std::size_t channel) const {
    return std::isfinite(v) && v < saturated_dn[channel];
  }
};

// Mean of the pixels of one channel in a ring of cells around a pixel: the noise of any nearer ones
// is in the same patch, and a patch's scale must not follow it.
double signal_around(const Frame& frame, int row, int col) {
  const int smaller = std::min(frame.layout.rows(), frame.layout.cols()),
            radius = std::max((kSide + smaller - 1) / smaller, 2);
  const std::size_t channel = frame.channel_at(row, col);
  double sum = 0;
  int count = 0;
  const auto add = [&](int i, int k) {
    const int r = row + i * frame.layout.rows(), c = col + k * frame.layout.cols();
    if (r < 0 || c < 0 || r >= frame.dn.rows() || c >= frame.dn.cols()) return;
    const float v = frame.dn(r, c);
    if (!frame.counts(v, channel)) return;
    sum += v;
    ++count;
  };
  for (int i = -radius; i < radius; ++i) {
    add(-radius, i);
    add(i, radius);
    add(radius, -i);
    add(-i, -radius);
  }
  return count > 0 ? sum / count : 0;
}

void normalise(const Frame& frame, const Unit& unit, Tile& tile) {
  tile.normal = Image(tile.units_down * unit.rows, tile.units_across * unit.cols);
  for (int r = 0; r < tile.normal.rows(); ++r)
    for (int c = 0; c < tile.normal.cols(); ++c) {
      const int row = tile.row0 + r, col = tile.col0 + c;
      const std::size_t k = frame.channel_at(row, col);
      const double signal = signal_around(frame, row, col), variance = frame.variance[k](signal);
      const bool dark = !frame.dark_dn.empty() && signal < frame.dark_dn[k];
      tile.normal(r, c) = frame.counts(frame.dn(row, col), k) && !dark && variance > 0
                              ? static_cast<float>(frame.dn(row, col) / std::sqrt(variance))
                              : std::numeric_limits<float>::quiet_NaN();
    }
}

// Squared differences to the pixels of the same channel one unit below and to the right.
void measure_units(const Frame& frame, const Unit& unit, Tile& tile) {
  const auto units =
      static_cast<std::size_t>(tile.units_down) * static_cast<std::size_t>(tile.units_across);
  tile.roughness.assign(units, 0.0);
  tile.signal.assign(units, 0.0);
  tile.counts.assign(units, 0.0);
  for (int i = 0; i + 1 < tile.units_down; ++i)
    for (int k = 0; k + 1 < tile.units_across; ++k) {
      double rough = 0, signal = 0;
      for (int r = i * unit.rows; r < (i + 1) * unit.rows; ++r)
        for (int c = k * unit.cols; c < (k + 1) * unit.cols; ++c) {
          const double v = tile.normal(r, c), below = tile.normal(r + unit.rows, c) - v,
                       right = tile.normal(r, c + unit.cols) - v;
          rough += below * below + right * right;
          signal += frame.dn(tile.row0 + r, tile.col0 + c);
        }
      if (!std::isfinite(rough)) continue;
      const auto at = static_cast<std::size_t>(i * tile.units_across + k);
      tile.roughness[at] = rough;
      tile.signal[at] = signal;
      tile.counts[at] = 1;
    }
}

// The units around those that share a pixel with the patch or with their differences.
bool measure_surroundings(const Tile& tile, int unit_row, int unit_col, int down, int across,
                          int pixels_per_unit, Patch& patch) {
  double rough = 0, signal = 0, count = 0;
  const int row1 = unit_row + down + kMargin, col1 = unit_col + across + kMargin;
  for (int i = unit_row - kMargin - 1; i < row1; ++i)
    for (int k = unit_col - kMargin - 1; k < col1; ++k) {
      if (i < 0 || k < 0 || i >= tile.units_down || k >= tile.units_across) continue;
      if (i >= unit_row - 1 && i < unit_row + down && k >= unit_col - 1 && k < unit_col + across)
        continue;
      const auto at = static_cast<std::size_t>(i * tile.units_across + k);
      rough += tile.roughness[at];
      signal += tile.signal[at];
      count += tile.counts[at];
    }
  if (!(count >= 8)) return false;
  patch.roughness = static_cast<float>(rough / count);
  patch.signal = static_cast<float>(signal / (count * pixels_per_unit));
  return true;
}

// Mean of the units [row, row1) x [col, col1) that count; NaN where none does.
double signal_of(const Tile& tile, const Unit& unit, int row, int col, int row1, int col1) {
  double signal = 0, count = 0;
  for (int i = std::max(row, 0); i < std::min(row1, tile.units_down); ++i)
    for (int k = std::max(col, 0); k < std::min(col1, tile.units_across); ++k) {
      const auto at = static_cast<std::size_t>(i * tile.units_across + k);
      signal += tile.signal[at];
      count += tile.counts[at];
    }
  return signal / (count * unit.rows * unit.cols);
}

// As bright as what is near it on every side, to a quarter or one deviation of the noise: else it
// would be measured by noise that is not its own, beside an edge by much more. Brightness itself
// counts: what texture has made of the given variance may tell no change.
bool is_even(const Frame& frame, const Tile& tile, const Unit& unit, int unit_row, int unit_col,
             int down, int across) {
  const int rows = kEvenMargin / unit.rows, cols = kEvenMargin / unit.cols;
  const int row = unit_row - rows, row1 = unit_row + down + rows, col = unit_col - cols,
            col1 = unit_col + across + cols;
  double least = std::numeric_limits<double>::infinity(), most = -least;
  for (const double signal :
       {signal_of(tile, unit, unit_row, unit_col, unit_row + down, unit_col + across),
        signal_of(tile, unit, row, col, unit_row, col1),
        signal_of(tile, unit, unit_row + down, col, row1, col1),
        signal_of(tile, unit, row, col, row1, unit_col),
        signal_of(tile, unit, row, unit_col + across, row1, col1)})
    if (std::isfinite(signal)) {
      least = std::min(least, signal);
      most = std::max(most, signal);
    }
  const double mean = (least + most) / 2;
  return most - least < std::max(kUnevenSignal * std::abs(mean),
                                 std::sqrt(mean_variance_dn2(frame.variance, mean)));
}

// Patches that begin `phase` pixels inside of a unit.
void cut_patches(const Frame& frame, const Tile& tile, const Unit& unit, int phase_row,
                 int phase_col, std::vector<Patch>& patches) {
  const int down = (phase_row + kSide + unit.rows - 1) / unit.rows,
            across = (phase_col + kSide + unit.cols - 1) / unit.cols;
  Patch patch;
  for (int i = 0; i + down <= tile.units_down; ++i)
    for (int k = 0; k + across <= tile.units_across; ++k) {
      const int row = i * unit.rows + phase_row, col = k * unit.cols + phase_col;
      // A patch that lies in both halves would be in neither's noise alone.
      bool whole = i % kHalfUnits + down <= kHalfUnits && k % kHalfUnits + across <= kHalfUnits;
      for (int r = 0; r < kSide; ++r)
        for (int c = 0; c < kSide; ++c) {
          const float v = tile.normal(row + r, col + c);
          patch.values[static_cast<std::size_t>(r * kSide + c)] = v;
          whole = whole && std::isfinite(v);
        }
      if (!whole || !measure_surroundings(tile, i, k, down, across, unit.rows * unit.cols, patch) ||
          !is_even(frame, tile, unit, i, k, down, across))
        continue;
      patch.second_half = (i / kHalfUnits + k / kHalfUnits) % 2 != 0;
      patches.push_back(patch);
    }
}

std::vector<Tile> tiles_of(const Frame& frame, const Unit& unit) {
  const int units_down = frame.dn.rows() / unit.rows, units_across = frame.dn.cols() / unit.cols;
  if (units_down < 1 || units_across < 1) return {};
  const int down = (units_down + kTileUnits - 1) / kTileUnits,
            across = (units_across + kTileUnits - 1) / kTileUnits;
  const std::int64_t all = std::int64_t{down} * across,
                     wanted = std::min<std::int64_t>(all, kMostTiles);
  std::vector<Tile> tiles;
  for (std::int64_t i = 0; i < wanted; ++i) {
    // Uneven distances: no column of tiles is chosen again and again.
    const double within = wanted < all ? std::fmod(static_cast<double>(i) * 0.618, 1.0) : 0.0;
    const auto number = static_cast<std::int64_t>(
        (static_cast<double>(i) + within) * static_cast<double>(all) / static_cast<double>(wanted));
    const auto tile_row = static_cast<int>(number / across),
               tile_col = static_cast<int>(number % across);
    tiles.push_back({tile_row * (units_down / down) * unit.rows,
                     tile_col * (units_across / across) * unit.cols,
                     units_down / down,
                     units_across / across,
                     {},
                     {},
                     {},
                     {}});
  }
  return tiles;
}

// Patches that begin at one of the mosaic's phases.
class PhasePatches {
 public:
  PhasePatches(const Frame& frame, const std::vector<Tile>& tiles, const Unit& unit, int phase_row,
               int phase_col)
      : of_tile_(tiles.size()) {
    parallel_for(0, std::ssize(tiles), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (auto i = static_cast<std::size_t>(begin); i < static_cast<std::size_t>(end); ++i)
        cut_patches(frame, tiles[i], unit, phase_row, phase_col, of_tile_[i]);
    });
  }
  std::vector<const Patch*> all() const {
    std::vector<const Patch*> all;
    for (const std::vector<Patch>& patches : of_tile_)
      for (const Patch& patch : patches) all.push_back(&patch);
    return all;
  }
  std::size_t size() const {
    std::size_t size = 0;
    for (const std::vector<Patch>& patches : of_tile_) size += patches.size();
    return size;
  }

 private:
  std::vector<std::vector<Patch>> of_tile_;
};

// The same number of pixels from every side of the phases.
std::vector<PhasePatches> patches_of(const Frame& frame) {
  const Unit unit = unit_of(frame.layout);
  std::vector<Tile> tiles = tiles_of(frame, unit);
  parallel_for(0, std::ssize(tiles), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (std::ptrdiff_t i = begin; i < end; ++i) {
      Tile& tile = tiles[static_cast<std::size_t>(i)];
      normalise(frame, unit, tile);
      measure_units(frame, unit, tile);
    }
  });
  std::vector<PhasePatches> patches;
  for (int row = 0; row < unit.rows; row += (unit.rows + 1) / 2)
    for (int col = 0; col < unit.cols; col += (unit.cols + 1) / 2) {
      // A cell of two by two looks the same from everywhere once its halves are in one patch.
      if ((row > 0 && unit.rows <= 2) || (col > 0 && unit.cols <= 2)) continue;
      patches.emplace_back(frame, tiles, unit, row, col);
    }
  return patches;
}

PatchMatrix half_of(std::span<const Patch* const> patches, bool second) {
  PatchMatrix half(std::ssize(patches), kPixels);
  Eigen::Index row = 0;
  for (const Patch* patch : patches)
    if (patch->second_half == second) {
      for (int i = 0; i < kPixels; ++i) half(row, i) = patch->values[static_cast<std::size_t>(i)];
      ++row;
    }
  half.conservativeResize(row, Eigen::NoChange);
  if (row > 0) half.rowwise() -= half.colwise().mean().eval();
  return half;
}

// NaN where there are too few patches.
double variance_of(std::span<const Patch* const> patches) {
  const PatchMatrix first = half_of(patches, false), second = half_of(patches, true);
  if (std::min(first.rows(), second.rows()) < kLeastPatches / 3)
    return std::numeric_limits<double>::quiet_NaN();
  return internal::quietest_variance(first, second);
}

// Of one level: of all its patches, or of the smoothest where those clearly hold less.
NoiseFloor floor_of(std::span<const Patch* const> level) {
  NoiseFloor floor;
  for (const Patch* patch : level)
    floor.signal_dn += static_cast<double>(patch->signal) / static_cast<double>(level.size());
  std::vector<const Patch*> patches(level.begin(), level.end());
  std::sort(patches.begin(), patches.end(),
            [](const Patch* a, const Patch* b) { return a->roughness < b->roughness; });
  floor.ratio = std::numeric_limits<double>::infinity();
  for (const double share : kShares) {
    const auto count = static_cast<std::size_t>(share * static_cast<double>(patches.size()));
    if (count < kLeastPatches) break;
    if (count < patches.size() &&
        patches[count]->roughness > kSmoother * patches[patches.size() / 2]->roughness)
      continue;
    const double variance = variance_of({patches.data(), count}),
                 error = internal::quietest_error(static_cast<double>(count));
    if (variance * (1 + kClearly * error) < floor.ratio) floor = {floor.signal_dn, variance, error};
  }
  return floor;
}

// As many as patches fill, and no more than differ in brightness, but for a twentieth at each end.
std::size_t level_count(const PhasePatches& patches) {
  std::vector<float> signals;
  for (const Patch* patch : patches.all()) signals.push_back(patch->signal);
  std::sort(signals.begin(), signals.end());
  const double low = signals[signals.size() / 20], high = signals[signals.size() * 19 / 20],
               middle = std::abs(signals[signals.size() / 2]);
  const auto most = std::clamp<std::size_t>(patches.size() / kPatchesPerLevel, 1, kMostFloors);
  if (high - low >= static_cast<double>(most) * kBrighter * middle) return most;
  return std::max<std::size_t>(static_cast<std::size_t>((high - low) / (kBrighter * middle)), 1);
}

std::vector<NoiseFloor> floors_of_phase(const PhasePatches& patches, std::size_t levels) {
  std::vector<const Patch*> by_signal = patches.all();
  std::sort(by_signal.begin(), by_signal.end(),
            [](const Patch* a, const Patch* b) { return a->signal < b->signal; });
  std::vector<NoiseFloor> floors(levels);
  parallel_for(0, std::ssize(floors), 1, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto i = static_cast<std::size_t>(first); i < static_cast<std::size_t>(last); ++i) {
      const std::size_t begin = i * by_signal.size() / levels,
                        end = (i + 1) * by_signal.size() / levels;
      floors[i] = floor_of({by_signal.data() + begin, end - begin});
    }
  });
  return floors;
}

}  // namespace

std::vector<NoiseFloor> noise_floor(View<const float> dn, const SensorLayout& layout,
                                    const std::vector<VarianceCurve>& variance,
                                    const std::vector<float>& saturated_dn,
                                    const std::vector<double>& dark_dn) {
  MALUS_REQUIRE(std::ssize(saturated_dn) == layout.channels() &&
                variance.size() == saturated_dn.size());
  const auto phases = patches_of({dn, layout, variance, saturated_dn, dark_dn});
  std::size_t least = phases.empty() ? 0 : phases.front().size();
  for (const PhasePatches& patches : phases) least = std::min(least, patches.size());
  if (least < kLeastPatches) return {};
  std::size_t levels = kMostFloors;
  for (const PhasePatches& patches : phases) levels = std::min(levels, level_count(patches));
  const double share = 1.0 / static_cast<double>(phases.size());
  std::vector<NoiseFloor> floors(levels);
  for (const PhasePatches& patches : phases) {
    const std::vector<NoiseFloor> own = floors_of_phase(patches, levels);
    for (std::size_t i = 0; i < levels; ++i) {
      floors[i].signal_dn += share * own[i].signal_dn;
      floors[i].ratio += share * own[i].ratio;
      floors[i].relative_error += share * own[i].relative_error * std::sqrt(share);
    }
  }
  for (const NoiseFloor& floor : floors)
    if (!std::isfinite(floor.ratio)) return {};
  return floors;
}

}  // namespace malus
