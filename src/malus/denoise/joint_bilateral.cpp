#include "malus/denoise/internal/joint_bilateral.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/bilateral_kernel.h"
#include "malus/denoise/internal/gaussian_means.h"
#include "malus/denoise/internal/kept_noise.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <vector>

namespace malus::internal {
namespace {

// All measured (docs/denoising-experiments.md, "Pixels that are alike").
// The first round looks near and tells where there is something to gain; there every other looks
// further, with what the one before has made for its guide. Polarization changes slowly beside
// print of one brightness, so sensors of it do not look furthest.
struct BilateralRound {
  int reach;  // steps of the layout
  float cut;  // in deviations of the guide's error
};
constexpr BilateralRound kBilateralRounds[] = {{4, 6.0f}, {8, 7.5f}, {16, 7.5f}};
std::span<const BilateralRound> rounds_for(const SensorLayout& layout) {
  return std::span(kBilateralRounds).first(layout.polarized() ? 2 : 3);
}
constexpr float kLeastDeviation = 0.3f;  // of the guide's error
// Where the estimate's residual lacks less of the noise than the first share nothing is changed,
// from the second on all that is to be gained: even light lacks up to the first by chance. It
// states less error than the third share, and has to lack by so much more.
constexpr float kLeastLack = 0.07f, kEnoughLack = 0.14f, kErrorOfDetail = 0.025f;
// What is gained is asked of small neighbourhoods (deviation and radius in cells), and this many
// standard errors are taken off.
constexpr float kGainDeviation = 2.5f;
constexpr int kGainRadius = 6;
constexpr float kGainErrors = 1.0f;
// A round works where the one before has gained this share of the noise, and fully where that has
// gained twice as much.
constexpr float kWorthwhile = 0.2f;
constexpr float kLeastShare = 0.05f;  // of the noise, for that ratio
// A mean errs by its own sample's share of the noise, were all of its pixels alike and counted
// alike. With those along edges it is this many times as much.
constexpr float kOwnAtEdges = 5.0f;
// A pixel that is most of its own mean has no like around it, as a star.
constexpr float kMostOwn = 0.7f;
constexpr int kBandCells = 8;  // rows of cells of a task

float ramp(float value, float begin, float end) {
  return std::clamp((value - begin) / (end - begin), 0.0f, 1.0f);
}

// Means over cells of what a round finds, and what it is told. What 2x2 pixels have in common is
// counted by itself (kept_noise.h).
struct BilateralSums {
  Image gate;                   // how much of a change may be taken
  Image gain, gain_common;      // Stein's estimate of (truth - estimate) (mean - estimate)
  Image energy, energy_common;  // (mean - estimate)²
  Image blind;                  // what the mean has of the guide's error, taken from 1
  Image own;                    // noise of a pixel's own sample in its mean
};

// Whose stated error changes with the estimate.
struct ErrorRows {
  Image* error;    // the frame's, or null
  int begin, end;  // of the strip
};

class Averaging {
 public:
  Averaging(PixelStrip& strip, const ErrorRows& stated, Progress& progress)
      : layout_(strip.layout),
        strip_(strip),
        samples_(strip.samples),
        estimate_(strip.estimate),
        stated_(stated),
        progress_(progress),
        rows_(strip.rows()),
        cols_(strip.cols()) {}

  void run() {
    for (const BilateralRound& round : rounds_for(layout_)) {
      kept_ = measure_kept_noise(strip_);
      if (cells_.gate.size() == 0) open_gates();
      if (std::none_of(cells_.gate.values().begin(), cells_.gate.values().end(),
                       [](float gate) { return gate > 0; }))
        return;
      average(round);
      take_change();
    }
  }

 private:
  void open_gates() {
    cells_.gate = strip_.cell_map();
    for (std::size_t i = 0; i < cells_.gate.size(); ++i) {
      const float lack = kept_.lack.values()[i];
      const float with_error = 2 * kept_.all.values()[i];
      cells_.gate.values()[i] =
          ramp(std::min(lack, with_error - kErrorOfDetail), kLeastLack, kEnoughLack);
    }
  }

  // Fills difference_, where a gate is near, and the sums.
  void average(const BilateralRound& round) {
    if (difference_.size() == 0) difference_ = Image(rows_, cols_);
    for (Image* map : {&cells_.gain, &cells_.gain_common, &cells_.energy, &cells_.energy_common,
                       &cells_.blind, &cells_.own})
      *map = strip_.cell_map();
    const int cell_rows = cells_.gate.rows(), bands = (cell_rows + kBandCells - 1) / kBandCells;
    parallel_for(0, bands, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int b = static_cast<int>(begin); b < static_cast<int>(end); ++b) {
        check_stop(progress_);
        average_band(round, b * kBandCells, std::min((b + 1) * kBandCells, cell_rows));
      }
    });
  }

  // Rows of cells [first, end).
  void average_band(const BilateralRound& round, int first, int end) {
    if (!is_open(first, end)) return;  // closed cells take no change
    const int blocks = (cols_ + kLanes - 1) / kLanes;
    const int margin_rows = round.reach * layout_.rows(),
              margin_cols = round.reach * layout_.cols();
    const int row0 = first * kCell, row1 = std::min(end * kCell, rows_);
    const int band_rows = row1 - row0 + 2 * margin_rows,
              band_cols = blocks * kLanes + 2 * margin_cols;
    Image samples(band_rows, band_cols), guide(band_rows, band_cols, kNoGuide);
    for (int r = 0; r < band_rows; ++r) {
      const int row = row0 + r - margin_rows;
      if (row < 0 || row >= rows_) continue;
      std::copy_n(samples_.row(row), cols_, samples.row(r) + margin_cols);
      std::copy_n(estimate_.row(row), cols_, guide.row(r) + margin_cols);
    }
    const auto width = static_cast<std::size_t>(blocks) * kLanes;
    std::vector<float> per_cut(width, 1.0f), mean(width), own(width), slope(width);
    std::vector<std::uint8_t> is_wanted(static_cast<std::size_t>(blocks));
    for (int i = first; i < end; ++i) {
      plan_cells(round, i, per_cut, is_wanted);
      for (int r = i * kCell; r < std::min((i + 1) * kCell, rows_); ++r) {
        const int inside = r - row0 + margin_rows;
        average_alike({samples.row(inside) + margin_cols, guide.row(inside) + margin_cols,
                       band_cols, layout_.rows(), layout_.cols(), round.reach, blocks,
                       is_wanted.data(), per_cut.data(), mean.data(), own.data(), slope.data()});
        add_row(r, is_wanted, mean, own, slope);
      }
      for (int k = 0; k < cells_.gate.cols(); ++k) add_common(i, k);
    }
  }

  bool is_open(int first, int end) const {
    return std::any_of(cells_.gate.row(first),
                       cells_.gate.row(first) + (end - first) * cells_.gate.cols(),
                       [](float gate) { return gate > 0; });
  }

  // Of the row of cells i.
  void plan_cells(const BilateralRound& round, int i, std::vector<float>& per_cut,
                  std::vector<std::uint8_t>& is_wanted) const {
    std::fill(is_wanted.begin(), is_wanted.end(), std::uint8_t{0});
    for (int c = 0; c < cols_; ++c) {
      const int k = c / kCell;
      per_cut[static_cast<std::size_t>(c)] =
          1.0f / (round.cut * std::max(std::sqrt(kept_.of_all(i, k)), kLeastDeviation));
      if (cells_.gate(i, k) > 0) is_wanted[static_cast<std::size_t>(c / kLanes)] = 1;
    }
  }

  void add_row(int r, const std::vector<std::uint8_t>& is_wanted, const std::vector<float>& mean,
               const std::vector<float>& own, const std::vector<float>& slope) {
    const int i = r / kCell;
    for (int c = 0; c < cols_; ++c) {
      const auto at = static_cast<std::size_t>(c);
      float& difference = difference_(r, c);
      difference = 0;
      if (!is_wanted[at / kLanes] || strip_.is_cut_off(r, c) || own[at] > kMostOwn) continue;
      const float rest = samples_(r, c) - estimate_(r, c);
      difference = mean[at] - estimate_(r, c);
      const int k = c / kCell;
      const float share = 1.0f / static_cast<float>(strip_.pixels_of(i, k));
      cells_.gain(i, k) += share * rest * difference;
      cells_.blind(i, k) += share * (1.0f - slope[at]);
      cells_.energy(i, k) += share * difference * difference;
      cells_.own(i, k) += share * own[at] * strip_.variance(r, c);
    }
  }

  // What the groups of the cell have in common, and in both gains the noise of the products: that
  // of the estimate, of which the mean keeps its slope, less that of the mean's own sample.
  void add_common(int i, int k) {
    strip_.for_groups(i, k, [&](const PixelGroup& group) {
      const float share =
          static_cast<float>(group.size()) / static_cast<float>(strip_.pixels_of(i, k));
      const float change = group.mean([&](int r, int c) { return difference_(r, c); });
      cells_.gain_common(i, k) += share * change * group.mean([&](int r, int c) {
        return samples_(r, c) - estimate_(r, c);
      });
      cells_.energy_common(i, k) += share * change * change;
    });
    const float blind = cells_.blind(i, k);
    const float common = 0.25f * (blind * kept_.of_common(i, k) - cells_.own(i, k));
    cells_.gain_common(i, k) += common;
    cells_.gain(i, k) += common + 0.75f * (blind * kept_.of_unlike(i, k) - cells_.own(i, k));
  }

  // The shares of a change that leave least error, as far as they are certain.
  struct Shares {
    float common = 0, unlike = 0;
  };

  void take_change() {
    for (Image* map : {&cells_.gain, &cells_.gain_common, &cells_.energy, &cells_.energy_common})
      *map = gaussian_means(*map, kGainDeviation, kGainRadius);
    parallel_for(0, cells_.gain.rows(), kBandCells, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
        for (int k = 0; k < cells_.gain.cols(); ++k) take_change_of(i, k);
    });
  }

  void take_change_of(int i, int k) {
    constexpr float kPixels =
        4 * std::numbers::pi_v<float> * kGainDeviation * kGainDeviation * kCell * kCell;
    const float noise = std::max(kept_.of_all(i, k), kLeastShare);
    float gained = 0, certain = 0;
    const auto share_of = [&](float gain, float moved) {
      const float sure = gain - kGainErrors * std::sqrt(std::max(moved, 0.0f) / kPixels);
      if (!(sure > 0) || !(moved > 0)) return 0.0f;
      const float share = cells_.gate(i, k) * std::min(sure / moved, 1.0f);
      gained += share * (2 * gain - share * moved);
      certain += share * (2 * sure - share * moved);
      return share;
    };
    const float common = cells_.energy_common(i, k);
    const Shares shares{
        share_of(cells_.gain_common(i, k), common),
        share_of(cells_.gain(i, k) - cells_.gain_common(i, k), cells_.energy(i, k) - common)};
    if (shares.common > 0 || shares.unlike > 0)
      change_cell(i, k, shares, std::max(1 - gained / noise, 0.0f));
    float& error = strip_.cell_error(i, k);
    error = std::min(std::max(error - gained, kOwnAtEdges * cells_.own(i, k)), error);
    cells_.gate(i, k) *= ramp(certain / noise, kWorthwhile, 2 * kWorthwhile);
  }

  // left: of the error around here.
  void change_cell(int i, int k, const Shares& shares, float left) {
    strip_.for_groups(i, k, [&](const PixelGroup& group) {
      const float common = group.mean([&](int r, int c) { return difference_(r, c); });
      for (int r = group.row; r < group.row_end; ++r)
        for (int c = group.col; c < group.col_end; ++c) {
          if (difference_(r, c) == 0) continue;
          estimate_(r, c) += shares.common * common + shares.unlike * (difference_(r, c) - common);
          if (stated_.error && r >= stated_.begin && r < stated_.end && !strip_.is_hidden(r, c))
            state_error(i, k, shares, left, (*stated_.error)(strip_.first_row + r, c));
        }
    });
  }

  // The two errors are of the same samples: they add up. But where some pixels are alike and others
  // are not, as along edges, the others' error remains.
  void state_error(int i, int k, const Shares& shares, float left, float& error) const {
    const float share = 0.25f * shares.common + 0.75f * shares.unlike;
    const float alike = (1 - share) * std::sqrt(error) + share * std::sqrt(cells_.own(i, k));
    error = std::min(std::max(alike * alike, left * error), error);
  }

  const SensorLayout& layout_;
  PixelStrip& strip_;
  const Image& samples_;
  Image& estimate_;
  ErrorRows stated_;
  Progress& progress_;
  int rows_, cols_;
  Image difference_;
  KeptNoise kept_;
  BilateralSums cells_;
};

// A pixel depends on none further above or below. Whole cells.
int averaging_reach(const SensorLayout& layout) {
  int reach = 0;
  for (const BilateralRound& round : rounds_for(layout))
    reach += (kGainRadius + 1) * kCell +
             std::max(round.reach * layout.rows(), (kNoiseRadius + 1) * kCell);
  return cell_count(reach) * kCell;
}

// Of the rows of cells that hold the rows [first, end); first begins one.
Image cells_between(const Image& cells, int first, int end) {
  Image part(cell_count(end - first), cells.cols());
  for (int i = 0; i < part.rows(); ++i)
    std::copy_n(cells.row(first / kCell + i), cells.cols(), part.row(i));
  return part;
}

// What the tiles of the filter had before is free; the least that they need is more than this.
int strip_rows(const Image& estimate, int reach, const MemoryBudget& memory) {
  constexpr double kBytesPerPixel = 15;  // samples, estimate, difference, maps of cells and bands
  const double rows = memory.bytes() / (kBytesPerPixel * std::max(estimate.cols(), 1)) - 2 * reach;
  if (rows >= estimate.rows()) return std::max(estimate.rows(), 1);
  return std::max(static_cast<int>(rows) / kCell, kBandCells) * kCell;
}

}  // namespace

void average_alike_pixels(const FrameSource& frame, const SampleNoise& noise,
                          const MemoryBudget& memory, const FrameEstimate& estimate,
                          Progress& progress) {
  Image& pixels = estimate.pixels;
  const int rows = frame.rows, cols = frame.cols, reach = averaging_reach(frame.layout);
  const int core_rows = strip_rows(pixels, reach, memory);
  Image above;  // the estimate before the change, up to the strip
  for (int core = 0; core < rows; core += core_rows) {
    const int core_end = std::min(core + core_rows, rows), first = std::max(core - reach, 0),
              end = std::min(core_end + reach, rows);
    PixelStrip strip{frame.layout,
                     Image(end - first, cols),
                     Image(end - first, cols),
                     cells_between(estimate.cell_error, first, end),
                     noise,
                     first};
    parallel_for(first, end, kRowsPerTask, [&](std::ptrdiff_t task, std::ptrdiff_t task_end) {
      for (int r = static_cast<int>(task); r < static_cast<int>(task_end); ++r) {
        const float* from = r < core ? above.row(r - core + above.rows()) : pixels.row(r);
        std::copy_n(from, cols, strip.estimate.row(r - first));
        for (int c = 0; c < cols; ++c) strip.samples(r - first, c) = frame.pixel(r, c);
      }
    });
    above = Image(std::min(reach, core_end), cols);
    for (int i = 0; i < above.rows(); ++i)
      std::copy_n(strip.estimate.row(core_end - above.rows() + i - first), cols, above.row(i));
    Averaging(strip, {estimate.error, core - first, core_end - first}, progress).run();
    for (int r = core; r < core_end; ++r)
      std::copy_n(strip.estimate.row(r - first), cols, pixels.row(r));
  }
}

}  // namespace malus::internal
