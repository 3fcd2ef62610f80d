#include "malus/denoise/internal/second_look.h"

#include "malus/base/statistics.h"
#include "malus/denoise/cut_off.h"
#include "malus/denoise/prepared_frame.h"
#include "malus/image/middle.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <span>
#include <utility>
#include <vector>

namespace malus::internal {
namespace {

// All measured (docs/noise-estimate.md, "A second look").
constexpr int kLookedAt = 512, kGlancedAt = 256;  // pixels per side of the middle
constexpr int kLookBlock = 16;                    // pixels per side
constexpr std::size_t kLeastLookBlocks = 16;
// Where the result states more of the noise for its error, it may have kept too much to tell.
constexpr double kQuietShare = 0.1;
constexpr double kContradiction = 0.9;
// Quarters of the blocks, and their dark and bright halves, differ by less: where they do not, the
// law is wrong and not its size.
constexpr double kEvenShares = 1.35, kEvenLevels = 1.25;
// Where the result states more of the noise for its error it is the picture itself, little changed:
// all there is was taken for noise, or all is texture. With no more noise than such a result took
// away it states less than kTells of it where the former is true.
constexpr double kKeepsAll = 0.7, kTells = 0.3;

struct DenoisedMiddle {
  PreparedFrame frame;
  Denoised result;
};

DenoisedMiddle denoise_middle(const RawFrame& middle, const NoiseProfile& profile) {
  Denoised result;
  PreparedFrame prepared = prepare_frame(middle, profile, {.compare_noise = false}, result);
  result.variance_dn2 = Image(prepared.dn.rows(), prepared.dn.cols());
  filter_prepared(prepared, profile, {}, silent_progress(), result);
  complete_result(prepared, result);
  return {std::move(prepared), std::move(result)};
}

// Of a pixel, in variances of the noise as it is told; nothing of pixels that do not tell.
struct PixelLook {
  double rest, stated;  // squared residual, stated squared error
};

std::optional<PixelLook> look_at(const DenoisedMiddle& middle, const NoiseProfile& profile, int r,
                                 int c) {
  if (middle.frame.saturated(r, c)) return std::nullopt;
  const auto channel = static_cast<std::size_t>(middle.frame.layout.channel_at(r, c));
  const double dn = middle.result.dn_above_black(r, c), rest = middle.frame.dn(r, c) - dn,
               told = profile.channels[channel].variance(dn),
               stated = (*middle.result.variance_dn2)(r, c);
  if (!std::isfinite(rest) || !std::isfinite(stated)) return std::nullopt;
  return PixelLook{rest * rest / told, stated / told};
}

struct LookBlock {
  Moments rest, stated;      // of all pixels that tell
  Moments share, signal_dn;  // of quiet ones
  bool is_quiet() const { return 2 * share.count() > kLookBlock * kLookBlock; }
};

// share: squared residuals over what the variance that is told leaves of itself if the stated error
// is all noise that was kept.
LookBlock block_at(const DenoisedMiddle& middle, const NoiseProfile& profile, int row, int col) {
  LookBlock block;
  for (int r = row; r < row + kLookBlock; ++r)
    for (int c = col; c < col + kLookBlock; ++c)
      if (const auto pixel = look_at(middle, profile, r, c)) {
        block.rest.add(pixel->rest);
        block.stated.add(pixel->stated);
        if (!(pixel->stated < kQuietShare)) continue;
        block.share.add(pixel->rest / std::pow(1 - std::sqrt(pixel->stated), 2));
        block.signal_dn.add(middle.result.dn_above_black(r, c));
      }
  return block;
}

std::vector<LookBlock> blocks_of(const DenoisedMiddle& middle, const NoiseProfile& profile) {
  std::vector<LookBlock> blocks;
  for (int row = 0; row + kLookBlock <= middle.frame.dn.rows(); row += kLookBlock)
    for (int col = 0; col + kLookBlock <= middle.frame.dn.cols(); col += kLookBlock) {
      const LookBlock block = block_at(middle, profile, row, col);
      if (block.rest.count() > 0) blocks.push_back(block);
    }
  return blocks;
}

std::vector<double> shares_of(std::span<const LookBlock> blocks) {
  std::vector<double> shares;
  for (const LookBlock& block : blocks) shares.push_back(block.share.mean());
  std::sort(shares.begin(), shares.end());
  return shares;
}

double median_over(const std::vector<LookBlock>& blocks, Moments LookBlock::*of) {
  std::vector<double> means;
  for (const LookBlock& block : blocks) means.push_back((block.*of).mean());
  return median_of(std::move(means));
}

// What quiet blocks have in common, where it is less than what is told.
std::optional<double> common_share(std::vector<LookBlock> blocks) {
  std::erase_if(blocks, [](const LookBlock& block) { return !block.is_quiet(); });
  const std::size_t n = blocks.size();
  if (n < kLeastLookBlocks) return std::nullopt;
  std::sort(blocks.begin(), blocks.end(), [](const LookBlock& a, const LookBlock& b) {
    return a.signal_dn.mean() < b.signal_dn.mean();
  });
  const std::vector<double> all = shares_of(blocks),
                            dark = shares_of(std::span(blocks).first(n / 2)),
                            bright = shares_of(std::span(blocks).last(n / 2));
  const double share = all[n / 2], of_dark = dark[n / 4], of_bright = bright[n / 4];
  const bool even = all[n * 3 / 4] < kEvenShares * all[n / 4] &&
                    std::max(of_dark, of_bright) < kEvenLevels * std::min(of_dark, of_bright);
  if (share > kContradiction || !even) return std::nullopt;
  return share;
}

}  // namespace

double kept_rounding_dn2(const NoiseProfile& profile, double share) {
  return (1 - share) * profile.step_dn * profile.step_dn / 12;
}

NoiseProfile with_scaled_variances(NoiseProfile profile, double share) {
  const double kept_dn2 = kept_rounding_dn2(profile, share);
  for (ChannelProfile& channel : profile.channels)
    channel.variance = channel.variance.scaled(share).plus(kept_dn2);
  return profile;
}

std::optional<double> share_that_result_shows(const RawFrame& frame, const NoiseProfile& profile,
                                              Look look) {
  check_frame(frame, profile);
  if (measure_cut_off(frame).mean_share() > 0) return std::nullopt;
  RawFrame middle = frame;
  middle.dn = middle_of(frame.dn, frame.layout, look == Look::kWhole ? kLookedAt : kGlancedAt);
  const std::vector<LookBlock> blocks = blocks_of(denoise_middle(middle, profile), profile);
  if (blocks.size() < kLeastLookBlocks) return std::nullopt;
  if (median_over(blocks, &LookBlock::stated) < kKeepsAll)
    return look == Look::kWhole ? common_share(blocks) : std::nullopt;
  const double left = median_over(blocks, &LookBlock::rest);
  if (!(left > 0) || left > kContradiction) return std::nullopt;
  const NoiseProfile lowered = with_scaled_variances(profile, left);
  const std::vector<LookBlock> again = blocks_of(denoise_middle(middle, lowered), lowered);
  if (!(median_over(again, &LookBlock::stated) < kTells)) return std::nullopt;
  return left * common_share(again).value_or(1);
}

}  // namespace malus::internal
