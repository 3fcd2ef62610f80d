#include "malus/calibrate/gain_map.h"

#include "malus/base/index.h"
#include "malus/calibrate/pixel_location.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kAcross = 4;
constexpr std::size_t kBlocks = kAcross * kAcross;

struct Sums {
  double squares = 0, signal = 0, pixels = 0;
};

// Without the pixels whose light is no ordinary one's: dead rows would be a block's variance.
std::vector<Sums> block_sums(const TemporalAccumulator& flat, const MosaicGeometry& geometry,
                             int channel) {
  std::vector<Sums> blocks(kBlocks);
  const View<const float> squares = flat.sum_of_squares(), mean = flat.aligned_mean_dn();
  const PixelLocation usual =
      location_of(geometry, channel, [&](int row, int col) { return mean(row, col); });
  const int rows = geometry.channel_rows(channel), cols = geometry.channel_cols(channel);
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    if (std::abs(mean(row, col) - usual.centre) > kDefectDeviations * usual.deviation) return;
    Sums& block = blocks[as_index(r * kAcross / rows * kAcross + c * kAcross / cols)];
    block.squares += squares(row, col);
    block.signal += mean(row, col);
    block.pixels += 1;
  });
  return blocks;
}

// Of one block, over the levels: gain - 1 = δ - a z, z = mean light x (its relative light - 1).
struct BlockLine {
  double weight = 0, gain = 0, place = 0;  ///< sums, then means
  double square_of_place = 0, product = 0;
};

std::vector<BlockLine> block_lines(const std::vector<GainBlocks>& levels) {
  std::vector<BlockLine> lines(kBlocks);
  for (int pass = 0; pass < 2; ++pass) {
    for (const GainBlocks& level : levels)
      for (std::size_t b = 0; b < level.gain.size(); ++b) {
        BlockLine& line = lines[b];
        const double weight = 1.0 / (level.gain_stderr[b] * level.gain_stderr[b]);
        const double gain = level.gain[b] - 1.0, place = level.mean_dn * (level.light[b] - 1.0);
        if (pass == 0) {
          line.weight += weight;
          line.gain += weight * gain;
          line.place += weight * place;
        } else {
          line.square_of_place += weight * (place - line.place) * (place - line.place);
          line.product += weight * (place - line.place) * (gain - line.gain);
        }
      }
    for (BlockLine& line : lines)
      if (pass == 0 && line.weight > 0) {
        line.gain /= line.weight;
        line.place /= line.weight;
      }
  }
  return lines;
}

}  // namespace

GainBlocks gain_blocks(const TemporalAccumulator& flat, const MosaicGeometry& geometry,
                       const std::vector<double>& dark_variance_dn2, double step_dn) {
  constexpr double kMostDark = 0.25, kFewestPixels = 16;
  GainBlocks out;
  if (flat.frames() < 2) return out;
  std::vector<double> gain(kBlocks, 0.0), light(kBlocks, 0.0), error(kBlocks, 0.0);
  const double channels = geometry.channels(), freedom = flat.frames() - 1.0;
  for (int c = 0; c < geometry.channels(); ++c) {
    const std::vector<Sums> blocks = block_sums(flat, geometry, c);
    Sums all;
    for (const Sums& block : blocks) {
      if (block.pixels < kFewestPixels) return out;
      all.squares += block.squares;
      all.signal += block.signal;
      all.pixels += block.pixels;
    }
    const double dark = dark_variance_dn2[as_index(c)];
    const double variance = all.squares / (all.pixels * freedom), mean = all.signal / all.pixels;
    if (!(mean > 0) || !(variance * kMostDark > dark) || !(variance > step_dn * step_dn))
      return out;
    for (std::size_t b = 0; b < kBlocks; ++b) {
      const double own = blocks[b].squares / (blocks[b].pixels * freedom),
                   own_mean = blocks[b].signal / blocks[b].pixels;
      if (!(own_mean > 0)) return out;
      gain[b] += (own - dark) / own_mean / ((variance - dark) / mean) / channels;
      light[b] += own_mean / mean / channels;
      const double relative = own / (own - dark) / channels;
      error[b] += 2.0 * relative * relative / (blocks[b].pixels * freedom);
    }
    out.mean_dn += mean / channels;
  }
  for (double& e : error) e = std::sqrt(e);
  out.gain = std::move(gain);
  out.light = std::move(light);
  out.gain_stderr = std::move(error);
  return out;
}

void warn_of_gain_map(const std::vector<GainBlocks>& levels, PhysicsCalibration& out) {
  constexpr double kLeast = 0.03, kDeviations = 5.2;
  const std::vector<BlockLine> lines = block_lines(levels);
  double square = 0, product = 0;
  for (const BlockLine& line : lines) {
    if (!(line.weight > 0)) return;
    square += line.square_of_place;
    product += line.product;
  }
  const double bend = square > 0 ? product / square : 0.0,
               bend_variance = square > 0 ? 1.0 / square : 0.0;
  std::vector<double> gain, light(kBlocks, 0.0);
  double chi_square = 0, used = 0;
  for (const BlockLine& line : lines) {
    gain.push_back(line.gain - bend * line.place);
    chi_square +=
        gain.back() * gain.back() / (1.0 / line.weight + bend_variance * line.place * line.place);
  }
  for (const GainBlocks& level : levels)
    for (std::size_t b = 0; b < level.light.size(); ++b) light[b] += level.light[b];
  for (const GainBlocks& level : levels) used += level.light.empty() ? 0 : 1;
  const auto [low, high] = std::minmax_element(gain.begin(), gain.end());
  const auto [dim, bright] = std::minmax_element(light.begin(), light.end());
  // Wilson and Hilferty's normal equivalent of a χ².
  const double k = kBlocks, third = 2.0 / (9.0 * k);
  const double deviations = (std::cbrt(chi_square / k) - 1.0 + third) / std::sqrt(third);
  if (!(*high - *low > kLeast) || !(deviations > kDeviations)) return;
  out.warnings.push_back(fmt::format(
      "K differs by {:.0f} % over the frame, the light by {:.0f} %: a flat-field or shading "
      "correction in the camera multiplies the pixels (turn it off), or parts of the sensor have "
      "gains of their own; the model has one K",
      100 * (*high - *low), 100 * (*bright - *dim) / used));
}

}  // namespace malus
