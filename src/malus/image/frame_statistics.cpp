#include "malus/image/frame_statistics.h"

#include "malus/base/statistics.h"
#include "malus/base/wording.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <limits>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kBlock = 8;
constexpr int kMinResponses = 256;

bool usable(float value, double white_dn) {
  return std::isfinite(value) && static_cast<double>(value) < white_dn;
}

// How much the block's four quadrants differ: low frequencies, nearly independent of the high-pass
// response that the noise is read from. NaN where a pixel is not usable.
double activity(View<const float> plane, int row0, int col0, double white_dn) {
  constexpr int kHalf = kBlock / 2;
  std::array<double, 4> mean{};
  for (int r = 0; r < kBlock; ++r)
    for (int c = 0; c < kBlock; ++c) {
      const float value = plane(row0 + r, col0 + c);
      if (!usable(value, white_dn)) return std::numeric_limits<double>::quiet_NaN();
      mean[static_cast<std::size_t>(r / kHalf * 2 + c / kHalf)] += static_cast<double>(value);
    }
  const auto [low, high] = std::minmax_element(mean.begin(), mean.end());
  return *high - *low;
}

double response(View<const float> plane, int r, int c) {
  const auto at = [&](int dr, int dc) { return static_cast<double>(plane(r + dr, c + dc)); };
  return (at(-1, -1) + at(-1, 1) + at(1, -1) + at(1, 1) -
          2.0 * (at(-1, 0) + at(1, 0) + at(0, -1) + at(0, 1)) + 4.0 * at(0, 0)) /
         6.0;
}

struct Block {
  double activity;
  int row0, col0;
};

constexpr int kMaxLooseStep = 256, kMinLooseStep = 16;

std::int64_t remainder_of(std::int64_t value, std::int64_t step) {
  return ((value % step) + step) % step;
}

// residues: which values modulo kMaxLooseStep occur.
ValueGrid loose_grid(const std::vector<bool>& residues, std::int64_t range) {
  constexpr int kMinSteps = 16;  // fewer steps in the data would be chance
  for (int step = kMaxLooseStep; step >= kMinLooseStep; step /= 2) {
    if (range < std::int64_t{kMinSteps} * step) continue;
    std::vector<bool> occurs(static_cast<std::size_t>(step), false);
    for (std::size_t i = 0; i < residues.size(); ++i)
      if (residues[i]) occurs[i % occurs.size()] = true;
    // The longest cyclic gap leaves the narrowest window that holds all residues.
    int gap = 0, longest = 0, after_longest = 0;
    for (int i = 0; i < 2 * step; ++i) {
      gap = occurs[static_cast<std::size_t>(i % step)] ? 0 : gap + 1;
      if (gap > longest && gap < step) {
        longest = gap;
        after_longest = (i + 1) % step;
      }
    }
    const int window = step - longest;
    if (window <= step / 8) return {step, after_longest, window - 1};
  }
  return {1, 0, 0};
}

// The median of values on a lattice: ties are spread evenly between the neighbouring values, or
// 8-bit data would give nothing between 0.49 and 0.74 DN. Reorders values.
double grouped_median(std::vector<double>& values) {
  std::sort(values.begin(), values.end());
  const double middle = values[values.size() / 2];
  const auto [low, high] = std::equal_range(values.begin(), values.end(), middle);
  const double below = low == values.begin() ? middle : *(low - 1);
  const double above = high == values.end() ? middle : *high;
  const double left = (below + middle) / 2, right = (middle + above) / 2;
  const double position =
      (static_cast<double>(values.size()) / 2 - static_cast<double>(low - values.begin())) /
      static_cast<double>(high - low);
  return left + position * (right - left);
}

// Shares of the finite pixels, and the largest of them.
struct BeyondLevels {
  double above = 0;  ///< share_beyond_white
  double below = 0;
  double largest_dn = 0;
};

BeyondLevels beyond_levels(const RawFrame& frame) {
  constexpr double kMargin = 0.1, kHotPixels = 1e-3;
  double above = 0, below = 0, pixels = 0, largest = 0;
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const double value = frame.dn(r, c), black = frame.black_at(r, c);
      if (!std::isfinite(value)) continue;
      const double margin = kMargin * (frame.white_dn - black);
      above += value > frame.white_dn + margin;
      below += value < black - margin;
      largest = std::max(largest, value);
      ++pixels;
    }
  if (pixels == 0) return {};
  // Of a range that nobody tells nothing is far away where no pixel is above black.
  const double highest_black_dn = *std::ranges::max_element(frame.black_dn);
  if (white_is_guessed(frame) && largest <= highest_black_dn) return {0, 0, largest};
  return {above > kHotPixels * pixels ? above / pixels : 0, below / pixels, largest};
}

}  // namespace

Estimate<NoiseGuess> noise_guess(View<const float> plane, double white_dn) {
  std::vector<Block> blocks;
  for (int row0 = 0; row0 + kBlock <= plane.rows(); row0 += kBlock)
    for (int col0 = 0; col0 + kBlock <= plane.cols(); col0 += kBlock) {
      const double value = activity(plane, row0, col0, white_dn);
      if (std::isfinite(value)) blocks.push_back({value, row0, col0});
    }
  std::stable_sort(blocks.begin(), blocks.end(),
                   [](const Block& a, const Block& b) { return a.activity < b.activity; });
  blocks.resize((blocks.size() + 1) / 2);
  std::vector<double> responses;
  double sum = 0;
  for (const Block& block : blocks)
    for (int r = 1; r < kBlock - 1; ++r)
      for (int c = 1; c < kBlock - 1; ++c) {
        responses.push_back(std::abs(response(plane, block.row0 + r, block.col0 + c)));
        sum += static_cast<double>(plane(block.row0 + r, block.col0 + c));
      }
  if (static_cast<int>(responses.size()) < kMinResponses)
    return Undecided{
        fmt::format("{} pixels to judge from, {} are needed", responses.size(), kMinResponses)};
  const double deviation = grouped_median(responses) / kMedianOfNormal;
  if (responses[responses.size() / 2] == 0)
    return Undecided{"most neighbours are equal: the noise lies below the steps of the data"};
  return NoiseGuess{deviation, sum / static_cast<double>(responses.size())};
}

std::vector<double> finite_means_dn(const RawFrame& frame) {
  const auto channels = static_cast<std::size_t>(frame.layout.channels());
  std::vector<double> mean_dn(channels, 0.0), pixels(channels, 0.0);
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const double value_dn = frame.dn(r, c);
      if (!std::isfinite(value_dn)) continue;
      const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
      mean_dn[channel] += value_dn;
      pixels[channel] += 1;
    }
  for (std::size_t c = 0; c < channels; ++c)
    mean_dn[c] = pixels[c] > 0 ? mean_dn[c] / pixels[c] : std::numeric_limits<double>::quiet_NaN();
  return mean_dn;
}

std::vector<ChannelSummary> summarize(const RawFrame& frame) {
  const Planes planes = pack(frame.dn, frame.layout);
  std::vector<ChannelSummary> summaries(static_cast<std::size_t>(frame.layout.channels()));
  const std::vector<double> mean_dn = finite_means_dn(frame);
  const double infinity = std::numeric_limits<double>::infinity();
  // White that is no more than the largest pixel tells nothing where that is not above black.
  const bool white_tells =
      !white_is_guessed(frame) || white_above_black(frame.white_dn, frame.black_dn) > 0;
  for (auto& summary : summaries) {
    summary.minimum_dn = infinity;
    summary.maximum_dn = -infinity;
  }
  // Over the mosaic, not the planes: packing repeats samples where a cell is cut off.
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
      ChannelSummary& summary = summaries[channel];
      const double value = static_cast<double>(frame.dn(r, c));
      ++summary.pixels;
      if (!std::isfinite(value)) {
        ++summary.nonfinite;
        continue;
      }
      summary.minimum_dn = std::min(summary.minimum_dn, value);
      summary.maximum_dn = std::max(summary.maximum_dn, value);
      summary.saturated_share += white_tells && value >= frame.white_dn ? 1.0 : 0.0;
      summary.below_black_share += value < frame.black_dn[channel] ? 1.0 : 0.0;
    }
  for (std::size_t channel = 0; channel < summaries.size(); ++channel) {
    ChannelSummary& summary = summaries[channel];
    const auto finite = static_cast<double>(summary.pixels - summary.nonfinite);
    const double nan = std::numeric_limits<double>::quiet_NaN();
    summary.mean_dn = mean_dn[channel];
    summary.saturated_share = finite > 0 ? summary.saturated_share / finite : 0.0;
    summary.below_black_share = finite > 0 ? summary.below_black_share / finite : 0.0;
    if (finite == 0) summary.minimum_dn = summary.maximum_dn = nan;
    const Estimate<NoiseGuess> noise =
        noise_guess(planes[static_cast<int>(channel)], frame.white_dn);
    summary.noise_dn =
        noise ? Estimate<double>(noise->deviation_dn) : Estimate<double>(Undecided{noise.reason()});
    if (noise) summary.noise_at_dn = noise->at_dn;
  }
  return summaries;
}

Estimate<ValueGrid> value_grid(View<const float> mosaic) {
  constexpr float kMaxExact = 16777216.0f;
  std::int64_t first = 0, lowest = 0, highest = 0, step = 0;
  bool any = false;
  std::vector<bool> residues(kMaxLooseStep, false);
  for (int r = 0; r < mosaic.rows(); ++r)
    for (const float value : mosaic.row_span(r)) {
      if (!std::isfinite(value)) continue;
      if (value != std::floor(value) || std::abs(value) > kMaxExact)
        return Undecided{"values are not whole numbers"};
      const auto whole = static_cast<std::int64_t>(value);
      if (!any) first = lowest = highest = whole;
      any = true;
      lowest = std::min(lowest, whole);
      highest = std::max(highest, whole);
      if (step != 1) step = std::gcd(step, whole - first);
      residues[static_cast<std::size_t>(remainder_of(whole, kMaxLooseStep))] = true;
    }
  if (!any) return Undecided{"no finite pixels"};
  if (step == 1) return loose_grid(residues, highest - lowest);
  return ValueGrid{static_cast<int>(step),
                   static_cast<int>(step > 0 ? remainder_of(first, step) : first)};
}

double share_beyond_white(const RawFrame& frame) { return beyond_levels(frame).above; }

std::string level_complaint(const RawFrame& frame) {
  constexpr double kMostBelow = 0.1;
  const BeyondLevels beyond = beyond_levels(frame);
  if (beyond.above > 0)
    return fmt::format("{:.3g} % of its pixels lie above the white level, check {}",
                       100 * beyond.above, setting("white"));
  if (beyond.below > kMostBelow)
    return fmt::format("{:.3g} % of its pixels lie far below the black level, check {}",
                       100 * beyond.below, setting("black"));
  const double most = std::ldexp(1.0, frame.bits) - 1;
  if (frame.bits > 0 && frame.white_dn > most && beyond.largest_dn <= most)
    return fmt::format("its {} bits do not reach the white level, check {}", frame.bits,
                       setting("white"));
  return "";
}

std::optional<ConverterGuess> converter_guess(int bits, double largest_dn, const ValueGrid& grid) {
  constexpr std::array kConverters = {8, 10, 12, 14};  // of the sensors that there are, and 16
  constexpr double kMostOfAny = 65535;
  if (bits <= 8 || !(largest_dn >= 0 && largest_dn <= kMostOfAny)) return std::nullopt;
  const int needed = std::bit_width(static_cast<unsigned>(largest_dn));
  const auto* const least = std::find_if(kConverters.begin(), kConverters.end(),
                                         [needed](int width) { return needed <= width; });
  const int fits = least == kConverters.end() ? 16 : *least;
  const int step = std::max(grid.spread == 0 ? grid.step : 1, 1);
  if (fits >= bits && step == 1) return std::nullopt;
  return ConverterGuess{fits, (1 << fits) - step};
}

}  // namespace malus
