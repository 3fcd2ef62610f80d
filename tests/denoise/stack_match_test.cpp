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
  job.block_cells = block_cells;
  job.period_rows = job.period_cols = period;
  job.search = search;
  job.stack = stack;
  return job;
}

struct Block {
  double distance;
  std::ptrdiff_t offset;
  std::size_t order;  ///< in the window, the near one first
};

// The blocks of a window with so many periods between them, but for those within `known` periods.
void add_plainly(const StackJob& job, int row, int col, int step, int known, double factor,
                 std::vector<Block>& blocks) {
  const int side = job.block_cells * kCell;
  for (int y = -job.search; y <= job.search; ++y)
    for (int x = -job.search; x <= job.search; ++x) {
      if (std::max(std::abs(y), std::abs(x)) * step <= known) continue;
      const int r = row + y * step * job.period_rows, c = col + x * step * job.period_cols;
      if (r < 0 || c < 0 || r + side > job.rows || c + side > job.cols) continue;
      double sum = y == 0 && x == 0 ? -1 : 0;
      for (int i = 0; i < side; ++i)
        for (int k = 0; k < side; ++k) {
          const double d = static_cast<double>(job.guide[(row + i) * job.stride + col + k]) -
                           static_cast<double>(job.guide[(r + i) * job.stride + c + k]);
          sum += d * d;
        }
      blocks.push_back({sum * factor, r * job.stride + c, blocks.size()});
    }
}

// All blocks of both windows by distance, those of the wide one 1.25 times as far; of equal ones
// the earlier first. The reference leads.
std::vector<Block> sorted_plainly(const StackJob& job, int row, int col) {
  std::vector<Block> blocks;
  add_plainly(job, row, col, 1, -1, 1, blocks);
  if (job.far_step > 1) add_plainly(job, row, col, job.far_step, job.search, 1.25, blocks);
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
    for (const int period : {1, 2}) {
      StackJob job = job_on(image, block_cells, period, 10, 64);
      job.far_step = kCell / period;
      const int side = block_cells * kCell;
      for (const int row : {0, 3, 61, 150 - side})
        for (const int col : {0, 7, 70, 169 - side, 170 - side})
          expect_plain_matches(job, row, col);
    }
}

// Squares of 8 pixels: of the blocks that are the same as a reference ten periods of two pixels
// hold twelve.
TEST(StackMatch, FindsWhatRepeatsFurtherAway) {
  Image board(200, 200);
  for (int r = 0; r < 200; ++r)
    for (int c = 0; c < 200; ++c) board(r, c) = (r / 8 + c / 8) % 2 ? 1.0f : 0.0f;
  StackJob job = job_on(board, 2, 2, 10, 32);
  const auto alike = [&] {
    std::vector<std::ptrdiff_t> matches;
    const int count = match_reference(job, 101, 99, matches);
    return std::count_if(matches.begin(), matches.begin() + count, [&](std::ptrdiff_t offset) {
      const auto row = static_cast<int>(offset / job.stride) - 101,
                 col = static_cast<int>(offset % job.stride) - 99;
      return row % 8 == 0 && col % 8 == 0 && (row + col) % 16 == 0;
    });
  };
  EXPECT_EQ(alike(), 13);
  job.far_step = 2;
  EXPECT_EQ(alike(), 32);
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
