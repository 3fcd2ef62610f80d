// The combination of a stack's blocks against the plain formula in double precision: weights over
// the blocks, where the kernel works with the blocks' values and a residual.
#include "malus/base/random.h"
#include "malus/denoise/internal/stack_kernel.h"

#include <cmath>

#include "denoise/instruction_sets.h"
#include <Eigen/Dense>
#include <gtest/gtest.h>

namespace malus::internal {
namespace {

constexpr int kSide = 24, kBlock = 2 * kCell, kPerBlock = kBlock * kBlock;
using Matrix = Eigen::MatrixXd;

// Cell c and lane k of a block's pixel.
int cell_of(int row, int col) { return row / kCell * 2 + col / kCell; }
int lane_of(int row, int col) { return row % kCell * kCell + col % kCell; }

// Blocks as columns, cell after cell.
Matrix blocks_of(const Image& image, const std::vector<std::ptrdiff_t>& at, int first, int count) {
  Matrix blocks(kPerBlock, count);
  for (int n = 0; n < count; ++n)
    for (int r = 0; r < kBlock; ++r)
      for (int c = 0; c < kBlock; ++c) {
        const auto offset = at[static_cast<std::size_t>(first + n)];
        blocks(cell_of(r, c) * kLanes + lane_of(r, c), n) =
            image(static_cast<int>(offset / kSide) + r, static_cast<int>(offset % kSide) + c);
      }
  return blocks;
}

Matrix cell_moments(const Matrix& blocks) {
  const Matrix cells = Eigen::Map<const Matrix>(blocks.data(), kLanes, blocks.size() / kLanes);
  return cells * cells.transpose() / static_cast<double>(cells.cols());
}

double kaiser(int i) {
  const double x = 2.0 * (i + 0.5) / kBlock - 1.0;
  return std::cyl_bessel_i(0.0, 2.0 * std::sqrt(1.0 - x * x));
}

// Every second cell of the blocks, as on a chessboard whose colours change from block to block.
Matrix half_of(const Matrix& blocks) {
  Matrix half(2 * kLanes, blocks.cols());
  for (int n = 0; n < blocks.cols(); ++n)
    for (int i = 0; i < 2; ++i)  // cells 0 and 3, or 1 and 2
      half.col(n).segment(i * kLanes, kLanes) =
          blocks.col(n).segment((n % 2 ? 1 + i : 3 * i) * kLanes, kLanes);
  return half;
}

// Principal axes of a stack as columns, the strongest first; the blocks beyond it count by 0.3.
Matrix axes_of(const Image& pilot, const std::vector<std::ptrdiff_t>& at, int count) {
  const int beyond = static_cast<int>(at.size()) - count;
  Matrix moments = cell_moments(blocks_of(pilot, at, 0, count));
  if (beyond > 0) moments += 0.3 * cell_moments(half_of(blocks_of(pilot, at, count, beyond)));
  const Eigen::SelfAdjointEigenSolver<Matrix> solver(moments);
  return solver.eigenvectors().rowwise().reverse();
}

// Sums and differences of the four cells of every component: rows as in a quarter, orthonormal.
Matrix cell_differences() {
  Matrix signs(4, 4);
  signs << 1, 1, 1, 1, 1, -1, 1, -1, 1, 1, -1, -1, 1, -1, -1, 1;
  Matrix all = Matrix::Zero(16, 16);
  for (int i = 0; i < 4; ++i)
    for (int k = 0; k < 4; ++k)
      all.block(4 * i, 4 * k, 4, 4) = 0.5 * signs(i, k) * Matrix::Identity(4, 4);
  return all;
}

// Gains of a quarter's values by their energy in the pilot, against a share of the noise that the
// weights let through; the four components of one difference between cells after another.
Eigen::VectorXd gain_values(const Matrix& pilot, const Matrix& weights) {
  const Eigen::ArrayXd energy = (cell_differences() * pilot).rowwise().squaredNorm().array();
  const Eigen::ArrayXd squares = (energy / (0.8 * weights.squaredNorm())).square();
  return squares / (squares + 1);
}

Matrix gains_of(const Matrix& pilot, const Matrix& weights) {
  const Matrix differences = cell_differences();
  return differences.transpose() * gain_values(pilot, weights).asDiagonal() * differences;
}

Matrix rotated(const Matrix& blocks, const Matrix& by) {
  Matrix result(blocks.rows(), blocks.cols());
  for (int cell = 0; cell < 4; ++cell)
    result.middleRows(cell * kLanes, kLanes) = by * blocks.middleRows(cell * kLanes, kLanes);
  return result;
}

// Rows of a block that a quarter of the components holds.
std::vector<int> rows_of(int quarter) {
  std::vector<int> rows;
  for (int cell = 0; cell < 4; ++cell)
    for (int k = 0; k < 4; ++k) rows.push_back(cell * kLanes + 4 * quarter + k);
  return rows;
}

Matrix weights_of(const Matrix& pilot) {
  const Matrix moments = 0.7 * pilot.transpose() * pilot;
  return (moments + 16.0 * Matrix::Identity(pilot.cols(), pilot.cols())).ldlt().solve(moments);
}

// kSide x kSide; not a number where no block lies.
Matrix put_together(const Matrix& blocks, const std::vector<std::ptrdiff_t>& at) {
  Matrix sum = Matrix::Zero(kSide, kSide), total = Matrix::Zero(kSide, kSide);
  for (int n = 0; n < blocks.cols(); ++n)
    for (int r = 0; r < kBlock; ++r)
      for (int c = 0; c < kBlock; ++c) {
        const auto offset = static_cast<int>(at[static_cast<std::size_t>(n)]);
        const int row = offset / kSide + r, col = offset % kSide + c;
        const double window = kaiser(r) * kaiser(c);
        sum(row, col) += window * blocks(cell_of(r, c) * kLanes + lane_of(r, c), n);
        total(row, col) += window;
      }
  return sum.cwiseQuotient(total);
}

Matrix combine_plainly(const Image& noisy, const Image& pilot,
                       const std::vector<std::ptrdiff_t>& at, int count, const Matrix& axes) {
  const Matrix p = rotated(blocks_of(pilot, at, 0, count), axes.transpose());
  const Matrix y = rotated(blocks_of(noisy, at, 0, count), axes.transpose());
  Matrix x(y.rows(), y.cols());
  for (int quarter = 0; quarter < 4; ++quarter) {
    const std::vector<int> rows = rows_of(quarter);
    const Matrix part = p(rows, Eigen::all), weights = weights_of(part);
    const Matrix combined = gains_of(part, weights) * y(rows, Eigen::all) * weights;
    for (std::size_t i = 0; i < rows.size(); ++i)
      x.row(rows[i]) = combined.row(static_cast<int>(i));
  }
  return put_together(rotated(x, axes), at);
}

// Variance of the estimate of unit noise with the pilot given, of one block at a time: its weights
// and gains squared, a component's mean over the block's four cells.
Matrix noise_plainly(const Image& pilot, const std::vector<std::ptrdiff_t>& at, int count,
                     const Matrix& axes) {
  const Matrix p = rotated(blocks_of(pilot, at, 0, count), axes.transpose());
  Matrix variances(p.rows(), p.cols());
  for (int quarter = 0; quarter < 4; ++quarter) {
    const std::vector<int> rows = rows_of(quarter);
    const Matrix part = p(rows, Eigen::all), weights = weights_of(part);
    const Eigen::ArrayXd gains = gain_values(part, weights).array();
    for (std::size_t i = 0; i < rows.size(); ++i) {
      double share = 0;
      for (int difference = 0; difference < 4; ++difference)
        share += std::pow(gains(4 * difference + static_cast<int>(i) % 4), 2) / 4;
      variances.row(rows[i]) = share * weights.colwise().squaredNorm();
    }
  }
  return put_together(rotated(variances, axes.cwiseAbs2()), at);
}

// One stack: the only reference is the frame's first pixel.
struct OneStack {
  StackTile noisy{Image(kSide, kSide), 0, 0};
  Image pilot{kSide, kSide};
  std::vector<CellMatrix> rotations = std::vector<CellMatrix>(1), no_prior = rotations;
  StackStage stage{.filter = StackFilter::ridge,
                   .block_cells = 2,
                   .step = 1000,
                   .search = 12,
                   .stack = 64,
                   .axes_prior = 1};

  explicit OneStack(double light)
      : OneStack(0.3, [&](int r, int c) {
          return light * (2 + std::sin(0.9 * r) * std::cos(0.4 * c) + 0.01 * r * (c % 4));
        }) {}
  template <class Scene>
  OneStack(double pilot_noise, const Scene& clean) {
    RandomSequence random(5, 0, Draw::kOther);
    for (int r = 0; r < kSide; ++r)
      for (int c = 0; c < kSide; ++c) {
        pilot(r, c) = static_cast<float>(clean(r, c) + pilot_noise * random.normal());
        noisy.pixels(r, c) = static_cast<float>(clean(r, c) + random.normal());
      }
  }
  Image estimate(Image* noise = nullptr, CellMap* unlike = nullptr) const {
    const StageInput input{.noisy = &noisy,
                           .guide = &pilot,
                           .period_rows = 1,
                           .period_cols = 1,
                           .frame_rows = kSide,
                           .frame_cols = kSide,
                           .rotations = &rotations,
                           .axes_prior = &no_prior};
    return run_stage(input, stage, silent_progress(), {.noise = noise, .unlike = unlike});
  }
  std::vector<std::ptrdiff_t> matches() const {
    StackJob job{};
    job.noisy = noisy.pixels.values().data();
    job.guide = pilot.values().data();
    job.stride = job.rows = job.cols = job.frame_rows = job.frame_cols = kSide;
    job.block_cells = 2;
    job.search = stage.search;
    job.stack = stage.stack;
    job.period_rows = job.period_cols = 1;
    std::vector<std::ptrdiff_t> at;
    const int count = match_reference(job, 0, 0, at);
    EXPECT_EQ(at.size(), static_cast<std::size_t>(2 * count));
    return at;
  }
};

// Where there are twice as many blocks as a stack has, that is what a search returns.
int members(const std::vector<std::ptrdiff_t>& matches) {
  return static_cast<int>(matches.size() / 2);
}

void expect_near(const Image& estimate, const Matrix& plain, double tolerance) {
  int compared = 0;
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c) {
      if (std::isnan(plain(r, c))) continue;
      ++compared;
      EXPECT_NEAR(estimate(r, c), plain(r, c), tolerance) << r << ' ' << c;
    }
  EXPECT_GT(compared, kSide * kSide / 3);
}

// Axes are given: those that hold nothing but the pilot's noise are not decided in floats where the
// brightness is a thousand times as strong.
void expect_plain_combination(OneStack one, double tolerance) {
  const auto at = one.matches();
  Matrix axes = axes_of(one.pilot, at, members(at));
  for (int i = 0; i < kLanes; ++i)
    for (int k = 0; k < kLanes; ++k) {
      const auto axis = static_cast<float>(axes(i, k));
      one.rotations[0][static_cast<std::size_t>(i)][static_cast<std::size_t>(k)] = axis;
      axes(i, k) = axis;
    }
  one.stage.axes_prior = kFrameAxes;
  expect_near(one.estimate(), combine_plainly(one.noisy.pixels, one.pilot, at, members(at), axes),
              tolerance);
}

class Ridge : public ::testing::TestWithParam<double> {};

// 3000 deviations of the noise are the brightest here; a sensor of 100,000 electrons has about 600.
TEST_P(Ridge, IsThePlainCombination) {
  expect_plain_combination(OneStack(GetParam()), 1e-4 + 2e-6 * GetParam());
}
INSTANTIATE_TEST_SUITE_P(Light, Ridge, ::testing::Values(1.0, 30.0, 1000.0));

// Bright edges: two values of a block that go together take every digit that a float has.
TEST(RidgeStack, CombinesBothSidesOfABrightEdge) {
  const auto edges = [](int, int c) { return c % 12 < 6 ? 60.0 : 150.0; };
  expect_plain_combination(OneStack(0.02, edges), 2e-3);
  const auto corners = [](int r, int c) { return (r / 10 + c / 10) % 2 ? 200.0 : 500.0; };
  expect_plain_combination(OneStack(0.02, corners), 3e-3);
}

TEST(RidgeStack, TakesTheStacksOwnAxes) {
  const OneStack one(1.0);
  const auto at = one.matches();
  const Matrix axes = axes_of(one.pilot, at, members(at));
  expect_near(one.estimate(), combine_plainly(one.noisy.pixels, one.pilot, at, members(at), axes),
              1e-3);
}

TEST(RidgeStack, TellsTheNoiseThatEveryBlockLetsThrough) {
  const OneStack one(3.0);
  const auto at = one.matches();
  const Matrix axes = axes_of(one.pilot, at, members(at));
  Image noise;
  (void)one.estimate(&noise);
  expect_near(noise, noise_plainly(one.pilot, at, members(at), axes), 1e-4);
}

// A block unlike all others of its stack is estimated by its own samples, with their noise; the
// others share theirs. Of the whole stack it is the same little noise.
TEST(StackNoise, IsThatOfTheBlock) {
  for (const StackFilter filter : {StackFilter::ridge, StackFilter::wiener}) {
    OneStack one(1.0);
    one.stage.filter = filter;
    const auto inside = [](int r, int c) { return r < kBlock && c < kBlock; };
    for (int r = 0; r < kSide; ++r)
      for (int c = 0; c < kSide; ++c)
        one.pilot(r, c) = inside(r, c) && (r + c) % 3 == 0 ? 80.0f : 20.0f;
    Image noise;
    (void)one.estimate(&noise);
    EXPECT_GT(noise(1, 1), 0.1f);
    // Of the last block in its row, which does not overlap it.
    EXPECT_LT(noise(1, 18), 0.1f * noise(1, 1));
    EXPECT_GT(noise(1, 18), 0.0f);
  }
}

TEST(StackNoise, IsTheSameOnEveryInstructionSet) {
  for (const StackFilter filter : {StackFilter::ridge, StackFilter::wiener}) {
    OneStack one(3.0);
    one.stage.filter = filter;
    expect_same_on_every_instruction_set(
        [&] {
          Image noise;
          (void)one.estimate(&noise);
          return noise;
        },
        1e-4);
  }
}

// The samples' variance about the stack's mean, less that of noise, in every cell that the stack
// reaches, as the members that the search returns have it.
TEST(StackUnlikeness, IsTheVarianceAboutTheMeanBeyondNoise) {
  for (const StackFilter filter : {StackFilter::ridge, StackFilter::wiener}) {
    OneStack one(3.0);
    one.stage.filter = filter;
    const auto at = one.matches();
    const Matrix blocks = blocks_of(one.noisy.pixels, at, 0, members(at));
    const Matrix rest = blocks.colwise() - blocks.rowwise().mean();
    const double unlike =
        rest.squaredNorm() / static_cast<double>(kPerBlock * (members(at) - 1)) - 1;
    EXPECT_GT(unlike, 0.1);
    CellMap map(one.noisy);
    (void)one.estimate(nullptr, &map);
    int reached = 0;
    for (const float value : map.values.values()) {
      if (value == kUnlikeAny) continue;
      EXPECT_NEAR(value, unlike, 1e-3);
      ++reached;
    }
    EXPECT_GT(reached, static_cast<int>(map.values.size()) / 3);
  }
}

TEST(StackUnlikeness, IsTheSameOnEveryInstructionSet) {
  const OneStack one(3.0);
  expect_same_on_every_instruction_set(
      [&] {
        CellMap unlike(one.noisy);
        (void)one.estimate(nullptr, &unlike);
        return unlike.values;
      },
      1e-4);
}

// Beyond the precision of floats the result still stays beside the samples.
TEST(RidgeLimits, AStackFarBrighterThanItsNoiseStaysWhatItIs) {
  const OneStack one(1e6);
  const Image estimate = one.estimate();
  for (std::size_t i = 0; i < estimate.size(); ++i)
    EXPECT_NEAR(estimate.values()[i], one.noisy.pixels.values()[i], 8.0);
}

}  // namespace
}  // namespace malus::internal
