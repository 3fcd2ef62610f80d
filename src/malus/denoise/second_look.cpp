#include "malus/denoise/internal/second_look.h"

#include "malus/denoise/cut_off.h"
#include "malus/denoise/prepared_frame.h"
#include "malus/image/middle.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
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
// Quarters of the blocks differ by less: where they do not, the law is wrong and not its size.
constexpr double kEvenShares = 1.35;

// Squared residuals over what the variance that is told leaves of itself if the stated error is all
// noise that was kept, means over blocks, ascending.
std::vector<double> residual_shares(const PreparedFrame& frame, const NoiseProfile& profile,
                                    const Denoised& result) {
  const auto rest_of = [&](int r, int c) -> std::optional<double> {
    const auto pixel = static_cast<std::size_t>(r) * static_cast<std::size_t>(frame.dn.cols()) +
                       static_cast<std::size_t>(c);
    if (frame.saturated(r, c) || (!frame.is_noiseless.empty() && frame.is_noiseless[pixel]))
      return std::nullopt;
    const double dn = result.dn_above_black(r, c), rest = frame.dn(r, c) - dn,
                 told = profile.channels[static_cast<std::size_t>(frame.layout.channel_at(r, c))]
                            .variance(dn);
    const double stated = (*result.variance_dn2)(r, c);
    if (!(stated < kQuietShare * told) || !std::isfinite(rest)) return std::nullopt;
    const double least = told * std::pow(1 - std::sqrt(stated / told), 2);
    return rest * rest / least;
  };
  std::vector<double> shares;
  for (int row = 0; row + kLookBlock <= frame.dn.rows(); row += kLookBlock)
    for (int col = 0; col + kLookBlock <= frame.dn.cols(); col += kLookBlock) {
      double sum = 0;
      int count = 0;
      for (int r = row; r < row + kLookBlock; ++r)
        for (int c = col; c < col + kLookBlock; ++c)
          if (const auto rest = rest_of(r, c)) {
            sum += *rest;
            ++count;
          }
      if (2 * count > kLookBlock * kLookBlock) shares.push_back(sum / count);
    }
  std::sort(shares.begin(), shares.end());
  return shares;
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
  const std::vector<double> shares = residual_shares(prepared, profile, result);
  const std::size_t n = shares.size();
  if (n < kLeastLookBlocks) return std::nullopt;
  const double share = shares[n / 2];
  if (share > kContradiction || shares[n * 3 / 4] > kEvenShares * shares[n / 4])
    return std::nullopt;
  return share;
}

}  // namespace malus::internal
