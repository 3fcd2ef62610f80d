#include "malus/denoise/internal/noiseless_areas.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/denoise/estimate_noise.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <limits>
#include <map>

namespace malus {
namespace {

constexpr std::int64_t kDominant = 4;  // times the areas of all other values

struct Shape {
  int rows, cols;
};

constexpr int kArea = kNoiseBlock * kNoiseBlock;
constexpr std::array kShapes{Shape{kNoiseBlock, kNoiseBlock}, Shape{1, kArea}, Shape{kArea, 1}};

// The pixels of one channel where they are in the mosaic.
struct ChannelPixels {
  View<const float> dn;
  const SensorLayout& layout;
  int row0, col0;

  int rows() const { return (dn.rows() - row0 + layout.rows() - 1) / layout.rows(); }
  int cols() const { return (dn.cols() - col0 + layout.cols() - 1) / layout.cols(); }
  int row(int i) const { return row0 + i * layout.rows(); }
  int col(int k) const { return col0 + k * layout.cols(); }
  float at(int i, int k) const { return dn(row(i), col(k)); }
  std::size_t place(int i, int k) const {  // in the mosaic
    return static_cast<std::size_t>(row(i)) * static_cast<std::size_t>(dn.cols()) +
           static_cast<std::size_t>(col(k));
  }
};

using Mask = std::vector<char>;                    // of a channel's pixels, row by row
using Corners = std::array<Mask, kShapes.size()>;  // of the shapes, in their order

void set(Mask& mask, std::size_t size, std::size_t place) {
  mask.resize(size);
  mask[place] = 1;
}

// First pixels of each of the shapes that hold one value; empty where there are none.
Corners corners_of(const ChannelPixels& channel) {
  const int rows = channel.rows(), cols = channel.cols(), step = channel.layout.cols();
  const std::size_t size = static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
  Corners corners;
  // Equal pixels from here down, and rows from here down that begin with a square's width of them.
  std::vector<int> height(static_cast<std::size_t>(cols)), deep(height);
  for (int i = rows - 1; i >= 0; --i) {
    const float *here = channel.dn.row(channel.row(i)) + channel.col0,
                *below = i + 1 < rows ? channel.dn.row(channel.row(i + 1)) + channel.col0 : nullptr;
    float right = std::numeric_limits<float>::quiet_NaN();
    int run = 0;
    for (int k = cols - 1; k >= 0; --k) {
      const auto at = static_cast<std::size_t>(k);
      const float v = here[k * step];
      run = v == right ? run + 1 : 1;
      right = v;
      const bool goes_on = below && below[k * step] == v;
      height[at] = goes_on ? height[at] + 1 : 1;
      deep[at] = run < kNoiseBlock ? 0 : goes_on ? deep[at] + 1 : 1;
      if (std::max(run, height[at]) < kArea && deep[at] < kNoiseBlock) continue;
      const std::size_t place = static_cast<std::size_t>(i) * static_cast<std::size_t>(cols) + at;
      if (deep[at] >= kNoiseBlock) set(corners[0], size, place);
      if (run >= kArea) set(corners[1], size, place);
      if (height[at] >= kArea) set(corners[2], size, place);
    }
  }
  return corners;
}

// Adds all pixels of the shapes with these first ones.
void add_shapes(const Mask& is_corner, int cols, Shape shape, Mask& in_area) {
  if (is_corner.empty()) return;
  in_area.resize(is_corner.size());
  std::vector<int> rows_left(static_cast<std::size_t>(cols));
  for (std::size_t first = 0; first < is_corner.size(); first += rows_left.size()) {
    int cols_left = 0;
    for (std::size_t k = 0; k < rows_left.size(); ++k) {
      if (is_corner[first + k]) rows_left[k] = shape.rows;
      if (rows_left[k] > 0) {
        --rows_left[k];
        cols_left = shape.cols;
      }
      if (cols_left > 0) {
        --cols_left;
        in_area[first + k] = 1;
      }
    }
  }
}

// Without those of values that do not stand out.
void keep_dominant(const ChannelPixels& channel, float saturated_dn, Mask& in_area) {
  const auto cols = static_cast<std::size_t>(channel.cols());
  const auto value = [&](std::size_t p) {
    return channel.at(static_cast<int>(p / cols), static_cast<int>(p % cols));
  };
  std::map<float, std::int64_t> areas;
  std::int64_t all = 0;
  for (std::size_t p = 0; p < in_area.size(); ++p)
    if (in_area[p] && value(p) < saturated_dn) {
      ++areas[value(p)];
      ++all;
    }
  const auto largest = std::max_element(
      areas.begin(), areas.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  const bool stands_out =
      largest != areas.end() && largest->second > kDominant * (all - largest->second);
  if (!stands_out) in_area.clear();
  for (std::size_t p = 0; p < in_area.size(); ++p)
    in_area[p] = in_area[p] && value(p) == largest->first;
}

// Blocks that are left to tell the noise.
int blocks_without(const ChannelPixels& channel, float saturated_dn, const Mask& in_area) {
  const int cols = channel.cols();
  const auto whole = [&](int row, int col) {
    for (int i = row; i < row + kNoiseBlock; ++i)
      for (int k = col; k < col + kNoiseBlock; ++k)
        if (!(channel.at(i, k) < saturated_dn) ||
            in_area[static_cast<std::size_t>(i) * static_cast<std::size_t>(cols) +
                    static_cast<std::size_t>(k)])
          return false;
    return true;
  };
  int blocks = 0;
  for (int i = 0; i + kNoiseBlock <= channel.rows(); i += kNoiseBlock)
    for (int k = 0; k + kNoiseBlock <= cols; k += kNoiseBlock) blocks += whole(i, k);
  return blocks;
}

}  // namespace

std::vector<bool> noiseless_areas(View<const float> dn, const SensorLayout& layout,
                                  const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(std::ssize(saturated_dn) == layout.channels());
  const auto pixels_of = [&](std::size_t k) {
    const int channel = static_cast<int>(k);
    return ChannelPixels{dn, layout, channel / layout.cols(), channel % layout.cols()};
  };
  std::vector<Mask> masks(saturated_dn.size());
  std::vector<char> enough(saturated_dn.size(), 1);
  parallel_for(0, std::ssize(masks), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto k = static_cast<std::size_t>(begin); k < static_cast<std::size_t>(end); ++k) {
      const ChannelPixels channel = pixels_of(k);
      const Corners corners = corners_of(channel);
      for (std::size_t i = 0; i < kShapes.size(); ++i)
        add_shapes(corners[i], channel.cols(), kShapes[i], masks[k]);
      keep_dominant(channel, saturated_dn[k], masks[k]);
      if (!masks[k].empty())
        enough[k] = blocks_without(channel, saturated_dn[k], masks[k]) >= kLeastNoiseBlocks;
    }
  });
  std::vector<bool> is_noiseless;
  if (std::count(enough.begin(), enough.end(), 0) > 0) return is_noiseless;
  for (std::size_t k = 0; k < masks.size(); ++k) {
    const ChannelPixels channel = pixels_of(k);
    const auto cols = static_cast<std::size_t>(channel.cols());
    if (!masks[k].empty())
      is_noiseless.resize(static_cast<std::size_t>(dn.rows()) *
                          static_cast<std::size_t>(dn.cols()));
    for (std::size_t p = 0; p < masks[k].size(); ++p)
      if (masks[k][p])
        is_noiseless[channel.place(static_cast<int>(p / cols), static_cast<int>(p % cols))] = true;
  }
  return is_noiseless;
}

}  // namespace malus
