// Which pixels of a mosaic belong to which channel and row group.
#pragma once

#include "malus/base/error.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <algorithm>
#include <cstdint>
#include <numeric>
#include <vector>

namespace malus {

/// Counts for a mosaic of rows x cols; row groups are numbered row / row_group from the top. Sums
/// over row groups are stored as [group * channels + channel]; a channel that has no pixel in a
/// group has count 0 there.
class MosaicGeometry {
 public:
  MosaicGeometry(const SensorLayout& layout, int rows, int cols, int row_group)
      : rows_(rows),
        cols_(cols),
        cell_rows_(layout.rows()),
        cell_cols_(layout.cols()),
        row_group_(row_group),
        channels_(layout.channels()) {
    MALUS_REQUIRE(rows >= cell_rows_ && cols >= cell_cols_ && row_group >= 1);
    group_pixels_.assign(static_cast<std::size_t>(groups()) * static_cast<std::size_t>(channels_),
                         0);
    channel_groups_.assign(static_cast<std::size_t>(channels_), 0);
    for (int r = 0; r < rows; ++r)
      for (int j = 0; j < cell_cols_; ++j) {
        int& count = group_pixels_[group_index(r / row_group, channel(r, j))];
        if (count == 0) ++channel_groups_[static_cast<std::size_t>(channel(r, j))];
        count += channel_cols(j);
      }
  }
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int cell_rows() const { return cell_rows_; }
  int cell_cols() const { return cell_cols_; }
  int channels() const { return channels_; }
  int row_group() const { return row_group_; }
  /// Row groups after which the layout repeats, and the first of them that holds the channel;
  /// row groups from one that holds it to the next.
  int group_phases() const { return std::lcm(cell_rows_, row_group_) / row_group_; }
  int group_phase(int c) const { return c / cell_cols_ / row_group_; }
  int group_stride(int c) const { return (groups() + channel_groups(c) / 2) / channel_groups(c); }
  int groups() const { return (rows_ + row_group_ - 1) / row_group_; }
  int channel(int row, int col) const { return (row % cell_rows_) * cell_cols_ + col % cell_cols_; }
  /// Columns (rows) of the mosaic that hold the channel.
  int channel_cols(int c) const { return (cols_ - c % cell_cols_ + cell_cols_ - 1) / cell_cols_; }
  int channel_rows(int c) const { return (rows_ - c / cell_cols_ + cell_rows_ - 1) / cell_rows_; }
  std::int64_t channel_pixels(int c) const {
    return std::int64_t{channel_rows(c)} * channel_cols(c);
  }
  std::size_t group_index(int group, int c) const {
    return static_cast<std::size_t>(group) * static_cast<std::size_t>(channels_) +
           static_cast<std::size_t>(c);
  }
  int group_pixels(int group, int c) const { return group_pixels_[group_index(group, c)]; }
  /// Row groups that hold the channel.
  int channel_groups(int c) const { return channel_groups_[static_cast<std::size_t>(c)]; }
  /// Pixels of the channel in a full row group.
  int pixels_per_group(int c) const {
    int most = 0;
    for (int g = 0; g < groups(); ++g) most = std::max(most, group_pixels(g, c));
    return most;
  }

 private:
  int rows_, cols_, cell_rows_, cell_cols_, row_group_, channels_;
  std::vector<int> group_pixels_, channel_groups_;
};

/// use(r, c, row, col) for one channel's pixels, line by line: their place in the channel and in
/// the mosaic.
template <class Use>
void for_channel(const MosaicGeometry& geometry, int channel, const Use& use) {
  for (int r = 0; r < geometry.channel_rows(channel); ++r)
    for (int c = 0; c < geometry.channel_cols(channel); ++c)
      use(r, c, channel / geometry.cell_cols() + r * geometry.cell_rows(),
          channel % geometry.cell_cols() + c * geometry.cell_cols());
}

/// Mean of every channel of a mosaic, summed in double.
std::vector<double> channel_means(View<const float> mosaic, const MosaicGeometry& geometry);

/// Some of a channel's pixels, 131072 at most: enough to use every code about the median.
std::vector<float> some_pixels(View<const float> dn, const MosaicGeometry& geometry, int channel);

}  // namespace malus
