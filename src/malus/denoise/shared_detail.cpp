#include "malus/denoise/shared_detail.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>

namespace malus {
namespace {

constexpr int kDetailBlock = 8, kDetails = kDetailBlock * kDetailBlock / 4;
constexpr std::size_t kLeastDetailBlocks = 64;
constexpr int kMostBlocks = 1 << 14;  // of a large frame, spread evenly: memory stays bounded
constexpr double kSmoothestShare = 0.4;
constexpr double kEdgeClip = 4.0;  // robust deviations: an edge must not decide alone

struct DetailBlock {
  double texture = 0;           // variance of the means of 2x2 pixels over their squared mean
  std::vector<Moments> coarse;  // [channel], those means
  std::vector<double> details;  // [channel][kDetails]
};

// False where a pixel does not count.
bool measure(const Image& plane, int row, int col, double saturated_dn, DetailBlock& block) {
  Moments coarse;
  for (int r = row; r < row + kDetailBlock; r += 2)
    for (int c = col; c < col + kDetailBlock; c += 2) {
      const double values[4] = {plane(r, c), plane(r, c + 1), plane(r + 1, c), plane(r + 1, c + 1)};
      for (const double v : values)
        if (!std::isfinite(v) || v >= saturated_dn) return false;
      coarse.add(0.25 * (values[0] + values[1] + values[2] + values[3]));
      block.details.push_back(0.5 * (values[0] - values[1] - values[2] + values[3]));
    }
  block.coarse.push_back(coarse);
  return true;
}

// Of blocks as dark as their details are large the mean tells nothing: their power is added to it.
void measure_texture(std::vector<DetailBlock>& blocks, int channels) {
  for (int k = 0; k < channels; ++k) {
    const auto channel = static_cast<std::size_t>(k);
    Moments details;
    for (const DetailBlock& block : blocks)
      for (int i = 0; i < kDetails; ++i)
        details.add(block.details[static_cast<std::size_t>(k * kDetails + i)]);
    for (DetailBlock& block : blocks) {
      const double mean = block.coarse[channel].mean();
      const double power = mean * mean + details.variance();
      if (power > 0) block.texture += block.coarse[channel].variance() / power;
    }
  }
}

std::vector<DetailBlock> smoothest_blocks(const Planes& planes,
                                          const std::vector<float>& saturated_dn) {
  const int across = planes.cols() / kDetailBlock, all = planes.rows() / kDetailBlock * across,
            stride = (all + kMostBlocks - 1) / kMostBlocks;
  std::vector<DetailBlock> blocks;
  for (int i = 0; i < all; i += stride) {
    const int r = i / across * kDetailBlock, c = i % across * kDetailBlock;
    DetailBlock block;
    bool counts = true;
    for (int k = 0; counts && k < planes.channels(); ++k)
      counts = measure(planes[k], r, c, saturated_dn[static_cast<std::size_t>(k)], block);
    if (counts) blocks.push_back(std::move(block));
  }
  measure_texture(blocks, planes.channels());
  std::stable_sort(blocks.begin(), blocks.end(), [](const DetailBlock& a, const DetailBlock& b) {
    return a.texture < b.texture;
  });
  if (blocks.size() >= kLeastDetailBlocks)
    blocks.resize(static_cast<std::size_t>(kSmoothestShare * static_cast<double>(blocks.size())));
  else
    blocks.clear();
  return blocks;
}

}  // namespace

double shared_detail(const Planes& planes, const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(std::ssize(saturated_dn) == planes.channels());
  const int channels = planes.channels();
  if (channels < 2) return 0.0;
  const std::vector<DetailBlock> blocks = smoothest_blocks(planes, saturated_dn);
  const auto samples = static_cast<Eigen::Index>(blocks.size()) * kDetails;
  if (samples <= 2 * channels) return 0.0;
  Eigen::MatrixXd details(samples, channels);
  for (int k = 0; k < channels; ++k) {
    std::vector<double> size;
    for (std::size_t b = 0; b < blocks.size(); ++b)
      for (int i = 0; i < kDetails; ++i) {
        const double d = blocks[b].details[static_cast<std::size_t>(k * kDetails + i)];
        details(static_cast<Eigen::Index>(b) * kDetails + i, k) = d;
        size.push_back(std::abs(d));
      }
    const double bound = kEdgeClip * median_of(std::move(size)) / kMedianOfNormal;
    if (!(bound > 0)) return 0.0;
    details.col(k) = details.col(k).cwiseMax(-bound).cwiseMin(bound) / bound;
  }
  // 1 / (C_kk (C⁻¹)_kk) is what a fit by the other channels leaves of channel k's power. A
  // billionth of the power keeps channels that are equal apart.
  Eigen::MatrixXd power = details.transpose() * details;
  power.diagonal() *= 1.0 + 1e-9;
  const Eigen::VectorXd inverse = power.inverse().diagonal();
  const double shared = 1.0 - (power.diagonal().cwiseProduct(inverse)).cwiseInverse().mean();
  return std::clamp(shared - (channels - 1.0) / static_cast<double>(samples), 0.0, 1.0);
}

}  // namespace malus
