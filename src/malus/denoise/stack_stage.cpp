#include "malus/denoise/internal/stack_stage.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/stack_kernel.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Eigenvalues>

namespace malus::internal {
namespace {

constexpr double kKaiserShape = 2.0;
// Of the noise's variance: the unbiased estimate of an error can come out below zero.
constexpr float kLeastError = 0.01f;

// Orthonormal DCT-II: matrix[k][i].
void fill_dct(int n, float (&matrix)[kMaxBlockCells][kMaxBlockCells]) {
  for (int k = 0; k < n; ++k)
    for (int i = 0; i < n; ++i)
      matrix[k][i] = static_cast<float>(std::sqrt((k ? 2.0 : 1.0) / n) *
                                        std::cos(std::numbers::pi * (i + 0.5) * k / n));
}

// Kaiser window along one side of a block.
std::vector<double> kaiser(int block) {
  std::vector<double> profile;
  for (int i = 0; i < block; ++i) {
    const double x = 2.0 * (i + 0.5) / block - 1.0;
    profile.push_back(std::cyl_bessel_i(0.0, kKaiserShape * std::sqrt(1.0 - x * x)) /
                      std::cyl_bessel_i(0.0, kKaiserShape));
  }
  return profile;
}

// Kaiser window over the block's pixels, as cells.
std::vector<CellVector> kaiser_cells(int side) {
  const int block = side * kCell;
  const std::vector<double> profile = kaiser(block);
  std::vector<CellVector> window(static_cast<std::size_t>(side * side));
  for (int r = 0; r < block; ++r)
    for (int c = 0; c < block; ++c)
      window[static_cast<std::size_t>(r / kCell * side + c / kCell)]
            [static_cast<std::size_t>(r % kCell * kCell + c % kCell)] = static_cast<float>(
                profile[static_cast<std::size_t>(r)] * profile[static_cast<std::size_t>(c)]);
  return window;
}

// What the windows of all blocks add up to in one row of pixels. weights: as StackJob::weight. Once
// for all is less work than for every block.
std::vector<float> sum_windows(const Image& weights, const std::vector<double>& profile, int row) {
  const auto size = static_cast<std::size_t>(weights.cols());
  std::vector<float> down(size), sums(size);
  for (std::size_t i = 0; i < profile.size(); ++i) {
    if (row < static_cast<int>(i)) break;
    const float share = static_cast<float>(profile[i]);
    const float* from = weights.row(row - static_cast<int>(i));
    for (std::size_t c = 0; c < size; ++c) down[c] += share * from[c];
  }
  for (std::size_t i = 0; i < profile.size(); ++i) {
    const float share = static_cast<float>(profile[i]);
    for (std::size_t c = i; c < size; ++c) sums[c] += share * down[c - i];
  }
  return sums;
}

// Positions of references along one axis, in tile coordinates: [begin, end) stepping by step.
struct Range {
  int begin, end;
};

// The part of the references of one square of the frame that lie in the tile and touch the frame.
Range references(int square, int square_size, int step, int block, int origin, int tile_size,
                 int frame_size) {
  const auto on_grid = [&](int global) { return -floor_div(-global, step) * step; };
  const int first = std::max({square * square_size, origin, 1 - block});
  const int last =
      std::min({(square + 1) * square_size, origin + tile_size - block + 1, frame_size});
  return {on_grid(first) - origin, std::max(last, first) - origin};
}

// Whether one of the stage's searches takes a step.
bool in_a_window(const StackJob& job, const RepeatStep& step) {
  const auto holds = [&](int far) {
    const int rows = job.period_rows * far, cols = job.period_cols * far;
    return step.rows % rows == 0 && step.cols % cols == 0 &&
           std::abs(step.rows) <= job.search * rows && std::abs(step.cols) <= job.search * cols;
  };
  return holds(1) || holds(job.far_step);
}

StackJob make_job(const StageInput& input, const StackStage& stage) {
  const Image& pixels = input.noisy->pixels;
  StackJob job{};
  job.noisy = pixels.values().data();
  job.guide = input.guide->values().data();
  job.stride = pixels.cols();
  job.rows = pixels.rows();
  job.cols = pixels.cols();
  job.row0 = input.noisy->row0;
  job.col0 = input.noisy->col0;
  job.frame_rows = input.frame_rows;
  job.frame_cols = input.frame_cols;
  job.filter = stage.filter;
  job.block_cells = stage.block_cells;
  job.step = stage.step;
  job.search = stage.search;
  job.far_step = stage.far_step;
  job.stack = stage.stack;
  job.threshold = stage.threshold;
  job.axes_prior = stage.axes_prior;
  job.period_rows = input.period_rows;
  job.period_cols = input.period_cols;
  if (input.repeats)
    job.repeats =
        input.repeats->where([&job](const RepeatStep& step) { return !in_a_window(job, step); });
  fill_dct(stage.block_cells, job.dct);
  job.window = kaiser_cells(stage.block_cells);
  job.rotations = input.rotations;
  job.priors = input.axes_prior;
  return job;
}

// A place for every reference of the tile.
ReferenceMap reference_grid(const StackJob& job) {
  const auto first = [&](int origin) { return -floor_div(-origin, job.step); };
  const auto count = [&](int origin, int size) {
    return floor_div(origin + size - 1, job.step) - first(origin) + 1;
  };
  return {job.step, first(job.row0), first(job.col0),
          Image(count(job.row0, job.rows), count(job.col0, job.cols))};
}

void make_grid(const StackJob& job, ReferenceMap& map, ReferenceValues<float>& values) {
  map = reference_grid(job);
  values = values_of<float>(map);
}

// Squares of references, in four groups: squares of a group write to disjoint parts of the tile, so
// the sums have one order whatever the number of threads.
void filter_all(const StackJob& job, const StageInput& input, const StackStage& stage,
                Progress& progress) {
  const int repeats = job.repeats.reach();
  const int reach_rows = std::max(stage.search_reach() * job.period_rows, repeats),
            reach_cols = std::max(stage.search_reach() * job.period_cols, repeats);
  const int size_rows = 2 * reach_rows + stage.block() + 1;
  const int size_cols = 2 * reach_cols + stage.block() + 1;
  const int first_row = floor_div(job.row0, size_rows);
  const int first_col = floor_div(job.col0, size_cols);
  const int squares_down = floor_div(job.row0 + job.rows - 1, size_rows) - first_row + 1;
  const int squares_across = floor_div(job.col0 + job.cols - 1, size_cols) - first_col + 1;
  for (int group = 0; group < 4; ++group) {
    std::vector<ReferenceBlock> blocks;
    for (int i = 0; i < squares_down; ++i)
      for (int k = 0; k < squares_across; ++k) {
        const int row = first_row + i, col = first_col + k;
        if ((row & 1) * 2 + (col & 1) != group) continue;
        const Range r = references(row, size_rows, job.step, stage.block(), job.row0, job.rows,
                                   input.frame_rows);
        const Range c = references(col, size_cols, job.step, stage.block(), job.col0, job.cols,
                                   input.frame_cols);
        if (r.begin < r.end && c.begin < c.end) blocks.push_back({r.begin, r.end, c.begin, c.end});
      }
    parallel_for(0, static_cast<std::ptrdiff_t>(blocks.size()), 1,
                 [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                   for (std::ptrdiff_t b = begin; b < end; ++b) {
                     check_stop(progress);
                     filter_references(job, blocks[static_cast<std::size_t>(b)]);
                   }
                 });
  }
}

// Means over the cells of what is summed at the blocks' first pixels, both as StackJob::weight. One
// row of every cell is enough, for windows are wider.
void average_unlikeness(const Image& unlike, const Image& weight,
                        const std::vector<double>& profile, const StackTile& tile, CellMap& map) {
  parallel_for(0, map.values.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i) {
      const int row =
          std::clamp((map.first_row + i) * kCell + kCell / 2 - tile.row0, 0, weight.rows() - 1);
      const std::vector<float> sums = sum_windows(unlike, profile, row),
                               weights = sum_windows(weight, profile, row);
      for (int k = 0; k < map.values.cols(); ++k) {
        const int left = (map.first_col + k) * kCell - tile.col0;
        float sum = 0, all = 0;
        for (int c = std::max(left, 0); c < std::min(left + kCell, weight.cols()); ++c) {
          sum += sums[static_cast<std::size_t>(c)];
          all += weights[static_cast<std::size_t>(c)];
        }
        map.values(i, k) = all > 0 ? sum / all : kUnlikeAny;
      }
    }
  });
}

}  // namespace

CellMatrix principal_axes(const CellMatrix& symmetric, CellVector* eigenvalues) {
  using Matrix = Eigen::Matrix<float, kLanes, kLanes>;
  Matrix m;
  for (int i = 0; i < kLanes; ++i)
    for (int k = 0; k < kLanes; ++k)
      m(i, k) = symmetric[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(m);
  CellMatrix axes;
  for (int k = 0; k < kLanes; ++k) {
    const int from = kLanes - 1 - k;  // Eigen sorts rising
    for (int i = 0; i < kLanes; ++i)
      axes[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)] =
          solver.eigenvectors()(i, from);
    if (eigenvalues) (*eigenvalues)[static_cast<std::size_t>(k)] = solver.eigenvalues()(from);
  }
  return axes;
}

Image run_stage(const StageInput& input, const StackStage& stage, Progress& progress,
                const StageReport& report) {
  const Image& noisy = input.noisy->pixels;
  MALUS_REQUIRE(input.guide->rows() == noisy.rows() && input.guide->cols() == noisy.cols());
  MALUS_REQUIRE(stage.stack >= 1 && stage.stack <= kMaxStack &&
                (stage.stack & (stage.stack - 1)) == 0);
  MALUS_REQUIRE(stage.block_cells == 2 ||
                (stage.block_cells == 4 && stage.filter != StackFilter::ridge));
  MALUS_REQUIRE((!report.evidence && !report.settled) || stage.filter == StackFilter::wiener);
  MALUS_REQUIRE(!report.stein || (!report.noise && stage.filter != StackFilter::ridge));
  MALUS_REQUIRE(noisy.rows() >= stage.block() && noisy.cols() >= stage.block());
  Image sum(noisy.rows(), noisy.cols()), weight(noisy.rows(), noisy.cols());
  Image* const error = report.noise ? report.noise : report.stein;
  if (error) *error = Image(noisy.rows(), noisy.cols());
  StackJob job = make_job(input, stage);
  job.sum = sum.values().data();
  job.weight = weight.values().data();
  job.error = error ? error->values().data() : nullptr;
  job.noise = report.noise != nullptr;
  if (report.passed) make_grid(job, *report.passed, job.passed);
  if (report.settled) make_grid(job, *report.settled, job.settled);
  if (report.evidence) {
    make_grid(job, report.evidence->excess, job.excess);
    make_grid(job, report.evidence->energy, job.energy);
  }
  if (input.doubt) job.doubt = values_of<const float>(*input.doubt);
  Image unlike;
  if (report.unlike) {
    unlike = Image(noisy.rows(), noisy.cols());
    job.unlike = unlike.values().data();
  }
  filter_all(job, input, stage, progress);
  const std::vector<double> profile = kaiser(stage.block());
  if (report.unlike) average_unlikeness(unlike, weight, profile, *input.noisy, *report.unlike);
  unlike = Image();
  parallel_for(0, noisy.rows(), 64, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r) {
      const std::vector<float> weights = sum_windows(weight, profile, r);
      float* to = sum.row(r);
      const float* samples = noisy.row(r);
      for (std::size_t c = 0; c < weights.size(); ++c) {
        const bool reached = weights[c] > 0;
        to[c] = (reached ? to[c] : samples[c]) / (reached ? weights[c] : 1.0f);
      }
      if (!error) continue;
      float* stated = error->row(r);
      const float least = report.noise ? 0.0f : kLeastError;
      for (std::size_t c = 0; c < weights.size(); ++c)
        stated[c] = weights[c] > 0 ? std::max(stated[c] / weights[c], least) : 1.0f;
    }
  });
  return sum;
}

}  // namespace malus::internal
