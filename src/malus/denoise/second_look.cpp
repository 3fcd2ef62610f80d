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
constexpr int kLookedAt = 512;  // pixels per side of the middle
constexpr int kLookBlock = 16;  // pixels per side
constexpr std::size_t kLeastLookBlocks = 16;
// Where the result states more of the noise for its error, it may have kept too much to tell.
constexpr double kQuietShare = 0.1;
constexpr double kContradiction = 0.9;
// Quarters of the blocks, and their dark and bright halves, differ by less: where they do not, the
// law is wrong and not its size.
constexpr double kEvenShares = 1.35, kEvenLevels = 1.25;

// Squared residuals over what the variance that is told leaves of itself if the stated error is all
// noise that was kept; nothing of pixels that do not tell.
std::optional<double> residual_share(const PreparedFrame& frame, const NoiseProfile& profile,
                                     const Denoised& result, int r, int c) {
  if (frame.saturated(r, c)) return std::nullopt;
  const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
  const double dn = result.dn_above_black(r, c), rest = frame.dn(r, c) - dn,
               told = profile.channels[channel].variance(dn), stated = (*result.variance_dn2)(r, c);
  if (!(stated < kQuietShare * told) || !std::isfinite(rest)) return std::nullopt;
  return rest * rest / (told * std::pow(1 - std::sqrt(stated / told), 2));
}

struct LookBlock {
  double share, signal_dn;  // means
};

// Most of whose pixels tell.
std::vector<LookBlock> blocks_of(const PreparedFrame& frame, const NoiseProfile& profile,
                                 const Denoised& result) {
  std::vector<LookBlock> blocks;
  for (int row = 0; row + kLookBlock <= frame.dn.rows(); row += kLookBlock)
    for (int col = 0; col + kLookBlock <= frame.dn.cols(); col += kLookBlock) {
      Moments shares, signal;
      for (int r = row; r < row + kLookBlock; ++r)
        for (int c = col; c < col + kLookBlock; ++c)
          if (const auto share = residual_share(frame, profile, result, r, c)) {
            shares.add(*share);
            signal.add(result.dn_above_black(r, c));
          }
      if (2 * shares.count() > kLookBlock * kLookBlock)
        blocks.push_back({shares.mean(), signal.mean()});
    }
  return blocks;
}

std::vector<double> shares_of(std::span<const LookBlock> blocks) {
  std::vector<double> shares;
  for (const LookBlock& block : blocks) shares.push_back(block.share);
  std::sort(shares.begin(), shares.end());
  return shares;
}

std::optional<double> common_share(std::vector<LookBlock> blocks) {
  const std::size_t n = blocks.size();
  if (n < kLeastLookBlocks) return std::nullopt;
  std::sort(blocks.begin(), blocks.end(),
            [](const LookBlock& a, const LookBlock& b) { return a.signal_dn < b.signal_dn; });
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

std::optional<double> share_that_result_shows(const RawFrame& frame, const NoiseProfile& profile) {
  check_frame(frame, profile);
  if (measure_cut_off(frame).mean_share() > 0) return std::nullopt;
  RawFrame middle = frame;
  middle.dn = middle_of(frame.dn, frame.layout, kLookedAt);
  Denoised result;
  const PreparedFrame prepared =
      prepare_frame(std::move(middle), profile, {.compare_noise = false}, result);
  result.variance_dn2 = Image(prepared.dn.rows(), prepared.dn.cols());
  filter_prepared(prepared, profile, {}, silent_progress(), result);
  complete_result(prepared, result);
  return common_share(blocks_of(prepared, profile, result));
}

}  // namespace malus::internal
