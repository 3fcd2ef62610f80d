#include "malus/base/random.h"
#include "malus/denoise/internal/stack_kernel.h"

#include <algorithm>
#include <limits>

#include <gtest/gtest.h>

namespace malus::internal {
namespace {

// Few whole values: float sums are exact, and many blocks are equally far.
Image few_levels(int rows, int cols, int levels) {
  Image image(rows, cols);
  RandomSequence random(1, 0, Draw::kScene, 0);
  for (float& value : image.values())
    value = static_cast<float>(static_cast<int>(random.uniform() * levels));
  return image;
}

StackJob job_on(const Image& image, int block_cells, int period, int search, int stack) {
  StackJob job{};
  job.guide = image.values().data();
  job.stride = image.cols();
  job.rows = image.rows();
  job.cols = image.cols();
  job.frame_rows = job.rows;
  job.frame_cols = job.cols;
  job.block_cells = block_cells;
  job.period_rows = job.period_cols = period;
  job.search = search;
  job.stack = stack;
  return job;
}

// Of what the wide search compares: half of a block of 8x8, a quarter of one of 16x16.
bool is_compared(int side, int r, int c) {
  const int row = r % 4 + r / 4, col = c % 4 + c / 4;
  return side == 8 ? (row + col) % 2 == 0 : row % 2 == 0 && col % 2 == 0;
}

struct Block {
  double distance;
  std::ptrdiff_t offset;
  std::size_t order;  ///< in the window, the near one first
};

// The blocks of a window with `step` periods between them, but for those within `known` periods;
// those of the wide window (known >= 0) lie in the frame, but for the reference's own rows and
// columns, and samples of them tell the distance.
void add_plainly(const StackJob& job, int row, int col, int step, int known, double factor,
                 std::vector<Block>& blocks) {
  const bool wide = known >= 0;
  const int top = wide ? std::max(-job.row0, 0) : 0, left = wide ? std::max(-job.col0, 0) : 0;
  const int bottom = wide ? std::min(job.frame_rows - job.row0, job.rows) : job.rows;
  const int right = wide ? std::min(job.frame_cols - job.col0, job.cols) : job.cols;
  const int side = job.block_cells * kCell;
  for (int y = -job.search; y <= job.search; ++y)
    for (int x = -job.search; x <= job.search; ++x) {
      if (std::max(std::abs(y), std::abs(x)) * step <= known) continue;
      const int r = row + y * step * job.period_rows, c = col + x * step * job.period_cols;
      if (y != 0 && (r < top || r + side > bottom)) continue;
      if (x != 0 && (c < left || c + side > right)) continue;
      double sum = y == 0 && x == 0 ? -1 : 0;
      for (int i = 0; i < side; ++i)
        for (int k = 0; k < side; ++k) {
          if (wide && !is_compared(side, i, k)) continue;
          const double d = static_cast<double>(job.guide[(row + i) * job.stride + col + k]) -
                           static_cast<double>(job.guide[(r + i) * job.stride + c + k]);
          sum += d * d;
        }
      blocks.push_back({sum * factor, r * job.stride + c, blocks.size()});
    }
}

// All blocks of both windows by distance, those of the wide one 1.25 times as far as their samples
// tell; of equal ones the earlier first. The reference leads.
std::vector<Block> sorted_plainly(const StackJob& job, int row, int col) {
  std::vector<Block> blocks;
  add_plainly(job, row, col, 1, -1, 1, blocks);
  if (job.far_step > 1)
    add_plainly(job, row, col, job.far_step, job.search, job.block_cells == 2 ? 2 * 1.25 : 4 * 1.25,
                blocks);
  std::stable_sort(blocks.begin(), blocks.end(),
                   [](const Block& a, const Block& b) { return a.distance < b.distance; });
  return blocks;
}

void expect_plain_matches(const StackJob& job, int row, int col) {
  std::vector<std::ptrdiff_t> matches;
  const int count = match_reference(job, row, col, matches);
  std::vector<Block> plain = sorted_plainly(job, row, col);
  const int there = static_cast<int>(plain.size());
  int expected = 1;
  while (2 * expected <= std::min(job.stack, there)) expected *= 2;
  ASSERT_EQ(count, expected);
  ASSERT_EQ(static_cast<int>(matches.size()), std::min(2 * count, there));
  plain.resize(matches.size());
  std::sort(plain.begin() + count, plain.end(),
            [](const Block& a, const Block& b) { return a.order < b.order; });
  for (std::size_t i = 0; i < matches.size(); ++i)
    ASSERT_EQ(matches[i], plain[i].offset) << "place " << i << " of (" << row << ", " << col << ")";
}

TEST(StackMatch, IsThePlainOrderInTheMiddleAtBordersAndInCorners) {
  const Image image = few_levels(150, 170, 3);
  for (const int block_cells : {2, 4})
    for (const int period : {1, 2, 4})
      for (const int stack : {16, 64}) {
        const StackJob job = job_on(image, block_cells, period, 10, stack);
        const int side = block_cells * kCell;
        for (const int row : {0, 3, 61, 150 - side})
          for (const int col : {0, 7, 70, 169 - side, 170 - side})
            expect_plain_matches(job, row, col);
      }
}

TEST(StackMatch, HoldsEveryBlockOfBothSearchesOnce) {
  const Image image = few_levels(150, 170, 3);
  for (const int block_cells : {2, 4})
    for (const int period : {1, 2, 4}) {
      StackJob job = job_on(image, block_cells, period, period == 4 ? 5 : 10, 64);
      job.far_step = std::max(kCell / period, 2);
      const int side = block_cells * kCell;
      for (const int row : {0, 3, 61, 150 - side})
        for (const int col : {0, 7, 70, 169 - side, 170 - side})
          expect_plain_matches(job, row, col);
    }
}

// A board of squares, a corner of four in the middle of the reference; how many of a stack's blocks
// are true copies of its reference, and how many it has.
struct Copies {
  int alike = 0, all = 0;
};
Copies copies_on_a_board(int squares, int period, int far_step, int stack) {
  Image board(400, 400);
  for (int r = 0; r < 400; ++r)
    for (int c = 0; c < 400; ++c) board(r, c) = (r / squares + c / squares) % 2 ? 10.0f : 0.0f;
  StackJob job = job_on(board, 2, period, 10, stack);
  job.far_step = far_step;
  std::vector<std::ptrdiff_t> matches;
  Copies copies;
  copies.all = match_reference(job, 204, 204, matches);
  for (int i = 0; i < copies.all; ++i) {
    const auto row = static_cast<int>(matches[static_cast<std::size_t>(i)] / job.stride) - 204,
               col = static_cast<int>(matches[static_cast<std::size_t>(i)] % job.stride) - 204;
    copies.alike += row % squares == 0 && col % squares == 0 && (row + col) % (2 * squares) == 0;
  }
  return copies;
}

// Ten periods of two pixels hold 12 of the blocks that are the same as a reference on squares of 8,
// ten of four pixels as many on squares of 16.
TEST(StackMatch, FindsWhatRepeatsFurtherAway) {
  for (const int period : {2, 4}) {
    EXPECT_LE(copies_on_a_board(4 * period, period, 1, 32).alike, 13);
    EXPECT_EQ(copies_on_a_board(4 * period, period, 2, 32).alike, 32);
  }
}

// Where true copies are few the stack has no others.
TEST(StackMatch, KeepsNoBlocksUnlikeTheOthers) {
  const Copies few = copies_on_a_board(16, 4, 1, 64);
  EXPECT_EQ(few.all, 8);
  EXPECT_EQ(few.alike, 8);
  const Copies many = copies_on_a_board(16, 4, 2, 64);
  EXPECT_EQ(many.all, 32);
  EXPECT_EQ(many.alike, 32);
}

// What noise of the guide makes of equal blocks is no reason, nor are distances that grow slowly.
TEST(StackMatch, KeepsWhatDiffersByNoiseOrByAndBy) {
  Image noise(150, 150), ramp(150, 150);
  RandomSequence random(3, 0, Draw::kScene, 0);
  for (float& value : noise.values()) value = 0.35f * static_cast<float>(random.normal());
  for (int r = 0; r < 150; ++r)
    for (int c = 0; c < 150; ++c) ramp(r, c) = 0.01f * static_cast<float>(r + c);
  std::vector<std::ptrdiff_t> matches;
  EXPECT_EQ(match_reference(job_on(noise, 2, 4, 10, 64), 71, 70, matches), 64);
  EXPECT_EQ(match_reference(job_on(ramp, 2, 4, 10, 64), 71, 70, matches), 64);
}

// Tiles hold so little of what lies beyond the frame that the wide search may not depend on it.
TEST(StackMatch, LooksFarAwayInTheFrameAlone) {
  StackJob job = job_on(few_levels(220, 220, 3), 2, 4, 5, 64);
  const Image image = few_levels(220, 220, 3);
  job.guide = image.values().data();
  job.far_step = 2;
  job.row0 = -48;
  job.col0 = -40;
  job.frame_rows = 150;
  job.frame_cols = 400;
  for (const int row : {43, 50, 61, 120, 193})
    for (const int col : {37, 41, 90, 211}) expect_plain_matches(job, row, col);
}

TEST(StackMatch, TakesTheEarlierOfEqualBlocks) {
  const Image flat(80, 80);
  expect_plain_matches(job_on(flat, 2, 4, 6, 32), 36, 36);
}

TEST(StackMatch, ContentsItselfWithWhatASmallFrameHas) {
  expect_plain_matches(job_on(few_levels(8, 8, 5), 2, 4, 10, 64), 0, 0);
  expect_plain_matches(job_on(few_levels(12, 16, 5), 2, 4, 10, 64), 4, 4);
}

TEST(StackMatch, PutsWhatIsNoNumberLast) {
  Image image = few_levels(64, 64, 3);
  for (const float bad :
       {std::numeric_limits<float>::quiet_NaN(), -std::numeric_limits<float>::quiet_NaN()}) {
    for (int r = 0; r < 24; ++r)
      for (int c = 0; c < 64; ++c) image(r, c) = bad;
    const StackJob job = job_on(image, 2, 4, 5, 8);
    std::vector<std::ptrdiff_t> matches;
    ASSERT_EQ(match_reference(job, 40, 32, matches), 8);
    ASSERT_EQ(matches.size(), 16U);
    for (const std::ptrdiff_t offset : matches) EXPECT_GE(offset / job.stride, 24);
  }
}

}  // namespace
}  // namespace malus::internal
