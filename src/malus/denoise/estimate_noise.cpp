#include "malus/denoise/estimate_noise.h"

#include "malus/base/statistics.h"
#include "malus/denoise/row_noise.h"
#include "malus/denoise/shared_detail.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kBlock = 8;         // pixels of one channel per side
constexpr int kLeastBlocks = 64;  // per channel
constexpr std::size_t kMostLevels = 16;
constexpr std::size_t kLeastPerLevel = 24;
// Two levels of a small frame cannot tell how the noise rises with the signal.
constexpr std::size_t kLeastLevels = 4;
constexpr int kPasses = 10;                // of reweighted fits
constexpr double kSmoothShare = 0.4;       // of a level's blocks
constexpr double kSharedIsTexture = 0.2;   // of the details, see shared_detail.h
constexpr double kPooledDeviation = 0.05;  // how far the channels' gains may differ
constexpr double kChance = 2.0;            // standard errors

struct Block {
  double mean = 0;
  double texture = 0;   ///< variance of the means of 2x2 pixels
  double variance = 0;  ///< from the diagonal second differences
};

bool measure_block(View<const float> plane, int row, int col, double saturated_dn, Block& block) {
  constexpr int kCells = kBlock / 2;
  double sum = 0, coarse_sum = 0, coarse_squares = 0, squares = 0;
  for (int i = 0; i < kCells; ++i)
    for (int k = 0; k < kCells; ++k) {
      const float *a = plane.row(row + 2 * i) + col + 2 * k,
                  *b = plane.row(row + 2 * i + 1) + col + 2 * k;
      const double values[4] = {a[0], a[1], b[0], b[1]};
      for (const double v : values)
        if (!std::isfinite(v) || v >= saturated_dn) return false;
      const double mean = 0.25 * (values[0] + values[1] + values[2] + values[3]);
      const double detail = 0.5 * (values[0] - values[1] - values[2] + values[3]);
      sum += mean;
      coarse_sum += mean;
      coarse_squares += mean * mean;
      squares += detail * detail;
    }
  constexpr double kCount = kCells * kCells;
  block.mean = sum / kCount;
  block.texture = coarse_squares / kCount - (coarse_sum / kCount) * (coarse_sum / kCount);
  block.variance = squares / kCount;
  return true;
}

// The least value of a pixel that does not tell its light: white, or less where so many pixels
// share the channel's largest value that they were clipped there, below a white that is not known.
// Noise ends in a tail: of pixels that are not clipped the largest value has fewer than the one
// below it.
float saturation_of(const Image& plane, double white_dn) {
  constexpr std::int64_t kPile = 4;                 // times the pixels of the value below
  constexpr std::int64_t kLeast = kBlock * kBlock;  // fewer fill no block
  float top = -std::numeric_limits<float>::infinity(), below = top;
  std::int64_t at_top = 0, at_below = 0;
  for (const float v : plane.values()) {
    if (!std::isfinite(v) || v < below) continue;
    if (v > top) {
      below = std::exchange(top, v);
      at_below = std::exchange(at_top, 0);
    } else if (v > below && v < top) {
      below = v;
      at_below = 0;
    }
    ++(v == top ? at_top : at_below);
  }
  const bool clipped = at_below > 0 && at_top >= kLeast && at_top > kPile * at_below;
  return clipped ? std::min(top, static_cast<float>(white_dn)) : static_cast<float>(white_dn);
}

std::vector<Block> measure_blocks(View<const float> plane, double saturated_dn) {
  std::vector<Block> blocks;
  Block block;
  for (int r = 0; r + kBlock <= plane.rows(); r += kBlock)
    for (int c = 0; c + kBlock <= plane.cols(); c += kBlock)
      if (measure_block(plane, r, c, saturated_dn, block)) blocks.push_back(block);
  return blocks;
}

// One point of variance against signal.
struct Level {
  double signal, variance;
  double relative_error;  ///< of the variance, one standard error
};

// The smoothest blocks of a run of blocks with similar means.
Level measure_level(std::vector<Block> blocks) {
  std::sort(blocks.begin(), blocks.end(),
            [](const Block& a, const Block& b) { return a.texture < b.texture; });
  const auto count =
      static_cast<std::size_t>(std::ceil(kSmoothShare * static_cast<double>(blocks.size())));
  std::vector<double> variances;
  double mean = 0;
  for (std::size_t i = 0; i < count; ++i) {
    variances.push_back(blocks[i].variance);
    mean += blocks[i].mean / static_cast<double>(count);
  }
  // Blocks whose details still hold texture lie far above the median: they are clipped. For 16
  // squares the median of their mean is 2/(9*16) below the expectation (Wilson, Hilferty, 1931).
  constexpr double kDegrees = kBlock * kBlock / 4.0;
  const double median_factor = std::pow(1.0 - 2.0 / (9.0 * kDegrees), 3);
  const double center = median_of(variances) / median_factor;
  const double spread = center * std::sqrt(2.0 / kDegrees);
  double sum = 0;
  int kept = 0;
  for (const double v : variances)
    if (v < center + 4 * spread) {
      sum += v;
      ++kept;
    }
  return {mean, kept > 0 ? sum / kept : center, std::sqrt(2.0 / kDegrees / std::max(kept, 1))};
}

std::vector<Level> measure_levels(std::vector<Block> blocks) {
  std::sort(blocks.begin(), blocks.end(),
            [](const Block& a, const Block& b) { return a.mean < b.mean; });
  const std::size_t levels =
      std::clamp<std::size_t>(blocks.size() / kLeastPerLevel, kLeastLevels, kMostLevels);
  std::vector<Level> result;
  for (std::size_t i = 0; i < levels; ++i)
    result.push_back(measure_level(
        {blocks.begin() + static_cast<std::ptrdiff_t>(i * blocks.size() / levels),
         blocks.begin() + static_cast<std::ptrdiff_t>((i + 1) * blocks.size() / levels)}));
  return result;
}

struct Line {
  double slope = 0, offset = 0, slope_error = 0, offset_error = 0;
};

// A billionth of the levels' variance.
double least_error_of(const std::vector<Level>& levels) {
  double highest = 0;
  for (const Level& l : levels) highest = std::max(highest, l.variance);
  return highest > 0 ? 1e-9 * highest : 1.0;
}

// Weight of a level for its distance above a line, in standard errors.
double weight_above(double above) { return above > 0 ? 1.0 / (1.0 + above * above / 9.0) : 1.0; }

// Texture only ever adds variance: levels above the line count less than levels below it.
// A level's error is taken from the fitted variance: its own would favour levels that came out low.
// least_error: what keeps the weight of a level without noise finite.
double weight_of(const Level& level, double fitted, double least_error) {
  const double error = level.relative_error * std::max(fitted, 0.1 * level.variance) + least_error;
  return weight_above((level.variance - fitted) / error) / (error * error);
}

// Read noise is not below zero: the slope is no steeper than any level's variance over its signal.
// Of few levels the brightest may hold nothing but the picture's detail, stars on a dark ground,
// and no other would tell.
void limit_slope(const std::vector<Level>& levels, Line& line) {
  constexpr std::size_t kFew = 8;
  constexpr double kErrors = 3.0;
  if (levels.size() >= kFew) return;
  for (const Level& l : levels)
    if (l.signal > 0)
      line.slope = std::min(line.slope, l.variance * (1.0 + kErrors * l.relative_error) / l.signal);
}

Line fit_levels(const std::vector<Level>& levels) {
  std::vector<double> x, y, weights(levels.size(), 1.0);
  for (const Level& l : levels) {
    x.push_back(l.signal);
    y.push_back(l.variance);
  }
  Line line;
  line.offset = mean_of(y);
  line.offset_error = levels.front().relative_error * line.offset;
  const auto [low, high] = std::minmax_element(x.begin(), x.end());
  if (!(*high - *low > 1e-6 * std::max(std::abs(*low), std::abs(*high)))) return line;
  const double least_error = least_error_of(levels);
  for (int pass = 0; pass < kPasses; ++pass) {
    const LineFit fit = fit_line(x, y, weights, pass > 0);
    line = {fit.slope, fit.intercept, fit.slope_standard_error, fit.intercept_standard_error};
    for (std::size_t i = 0; i < x.size(); ++i)
      weights[i] = weight_of(levels[i], line.offset + line.slope * x[i], least_error);
  }
  return line;
}

// The line as a curve, no lower than a tenth of the lowest level's variance.
VarianceCurve curve_of(const Line& line, const std::vector<Level>& levels) {
  double least = levels.front().variance;
  for (const Level& l : levels) least = std::min(least, l.variance);
  return VarianceCurve::fitted_line(std::max(line.slope, 0.0), line.offset, 0.1 * least);
}

// Channels of one sensor share their gain up to a few per cent: each line is drawn to the mean one.
// Slopes below zero by chance count as well: of a scene of nearly one brightness half of them are,
// and the mean of the others would be far too steep. Those that fall by more than chance have
// texture in the dark and tell nothing.
void pool(std::vector<Line>& lines) {
  double slope = 0, weight = 0;
  for (const Line& l : lines)
    if (l.slope_error > 0 && l.slope > -kChance * l.slope_error) {
      const double w = 1.0 / (l.slope_error * l.slope_error +
                              kPooledDeviation * kPooledDeviation * l.slope * l.slope);
      slope += w * l.slope;
      weight += w;
    }
  slope = weight > 0 ? std::max(slope / weight, 0.0) : 0.0;
  const double prior = kPooledDeviation * slope;
  for (Line& l : lines) {
    const double variance = l.slope_error * l.slope_error;
    const double trust =
        l.slope > 0 && slope > 0 ? prior * prior / (prior * prior + variance) : 0.0;
    l.slope = slope + trust * (l.slope - slope);
  }
}

// The offset that carries the pooled slope through the channel's levels; returns the sum of
// weights.
double fit_offset(const std::vector<Level>& levels, Line& line) {
  double weight = 0;
  const double least_error = least_error_of(levels);
  for (int pass = 0; pass < kPasses; ++pass) {
    double weighted = 0;
    weight = 0;
    for (const Level& l : levels) {
      const double w = weight_of(l, line.offset + line.slope * l.signal, least_error);
      weighted += w * (l.variance - line.slope * l.signal);
      weight += w;
    }
    line.offset = weighted / weight;
  }
  return weight;
}

double mean_signal(const std::vector<Block>& blocks) {
  double sum = 0;
  for (const Block& b : blocks) sum += b.mean;
  return sum / static_cast<double>(std::max<std::size_t>(blocks.size(), 1));
}

// The rest is what the other channels' detail leaves of a channel's own power: the noise, and
// texture finer than the channels are apart.
void take_texture_off(double shared, std::vector<std::vector<Level>>& levels,
                      std::vector<Line>& lines) {
  const double rest = 1.0 - shared;
  for (std::vector<Level>& of_channel : levels)
    for (Level& level : of_channel) level.variance *= rest;
  for (Line& line : lines) {
    line.offset *= rest;
    line.slope *= rest;
  }
}

std::string trust_statement(const PictureNoise& noise, double deviation_dn) {
  return fmt::format(
      "noise estimated from the picture itself: deviation {:.2f} DN at its mean signal, ±{:.0f} % "
      "by sampling, from {:.0f} % of the picture and {} levels of brightness; texture can make it "
      "too "
      "high, earlier smoothing too low, and the dark bias is not known",
      deviation_dn, std::max(100 * noise.relative_error, 1.0), 100 * noise.smooth_share,
      noise.levels);
}

}  // namespace

Estimate<PictureNoise> estimate_profile(const RawFrame& frame) {
  const double range_dn = white_above_black(frame.white_dn, frame.black_dn);
  Planes planes = pack(frame.dn, frame.layout);
  for (int k = 0; k < planes.channels(); ++k)
    for (float& v : planes[k].values())
      v -= static_cast<float>(frame.black_dn[static_cast<std::size_t>(k)]);
  std::vector<std::vector<Level>> levels;
  std::vector<Line> lines;
  std::vector<double> means;
  std::vector<float> saturated_dn;
  PictureNoise noise;
  double usable = 0, all = 0;
  for (const Image& plane : planes) {
    saturated_dn.push_back(saturation_of(plane, range_dn));
    const std::vector<Block> blocks = measure_blocks(plane, saturated_dn.back());
    if (blocks.size() < kLeastBlocks)
      return Undecided{
          fmt::format("{} unsaturated blocks of {} x {} pixels per channel; {} are needed",
                      blocks.size(), kBlock, kBlock, kLeastBlocks)};
    usable += kSmoothShare * static_cast<double>(blocks.size());
    all += static_cast<double>(plane.rows() / kBlock) * (plane.cols() / kBlock);
    levels.push_back(measure_levels(blocks));
    lines.push_back(fit_levels(levels.back()));
    if (frame.black_known) limit_slope(levels.back(), lines.back());
    means.push_back(mean_signal(blocks));
    noise.levels += static_cast<int>(levels.back().size());
  }
  pool(lines);
  noise.texture_share = shared_detail(planes, saturated_dn);
  take_texture_off(noise.texture_share, levels, lines);
  noise.levels /= planes.channels();
  noise.smooth_share = usable / all;
  noise.profile.layout = frame.layout;
  noise.profile.estimated_from_picture = true;
  double deviation = 0, error = 0;
  for (std::size_t k = 0; k < lines.size(); ++k) {
    Line line = lines[k];
    const double weight = fit_offset(levels[k], line);
    ChannelProfile channel;
    channel.variance = curve_of(line, levels[k]);
    const double variance = channel.variance(means[k]);
    deviation += std::sqrt(variance) / static_cast<double>(lines.size());
    error +=
        variance > 0 ? 0.5 / (std::sqrt(weight) * variance) / static_cast<double>(lines.size()) : 0;
    noise.profile.channels.push_back(channel);
  }
  if (!(deviation > 1e-6 * std::max(range_dn, 1e-30)))
    return Undecided{"the picture has no noise that could be measured"};
  noise.relative_error = error;
  Image dn(frame.dn.rows(), frame.dn.cols());
  unpack(planes, frame.layout, dn);
  estimate_row_deviation(dn, saturated_dn, noise.profile);
  noise.trust = trust_statement(noise, deviation);
  if (noise.texture_share > kSharedIsTexture)
    noise.trust += fmt::format(
        "; {:.0f} % of what looked like noise is alike in neighbouring channels, which noise never "
        "is: it is texture and was left out; finer texture was not, so the result may be blurred "
        "and too bright",
        100 * noise.texture_share);
  return noise;
}

PictureNoise require_estimate(const RawFrame& frame, std::string_view remedy) {
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  if (!noise)
    throw InputError(frame.source.empty() ? "the picture" : frame.source,
                     "its noise cannot be estimated: " + noise.reason(), std::string(remedy));
  return *noise;
}

}  // namespace malus
