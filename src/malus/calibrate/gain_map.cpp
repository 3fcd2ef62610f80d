#include "malus/calibrate/internal/gain_map.h"

#include "malus/base/chi_square.h"
#include "malus/base/index.h"
#include "malus/calibrate/internal/pixel_location.h"

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
  double own_error2 = 0;  ///< of the gain, of pixels; the rest of 1 / weight is that of rows
};

// Sampling variance of a block's gain that its rows' offsets make, which its pixels' errors do not
// hold: σ_b⁴ once per row group.
double row_error2(const GainBlocks& level, std::size_t block, const RowsOfFrame& rows) {
  if (!(rows.groups > 0)) return 0;
  const double relative = rows.variance_dn2 / (level.light_variance_dn2 * level.light[block]);
  return 2.0 * relative * relative * kAcross / (rows.groups * (level.frames - 1.0));
}

std::vector<BlockLine> block_lines(const std::vector<GainBlocks>& levels, const RowsOfFrame& rows) {
  std::vector<BlockLine> lines(kBlocks);
  for (int pass = 0; pass < 2; ++pass) {
    for (const GainBlocks& level : levels)
      for (std::size_t b = 0; b < level.gain.size(); ++b) {
        BlockLine& line = lines[b];
        const double own = level.gain_stderr[b] * level.gain_stderr[b],
                     weight = 1.0 / (own + row_error2(level, b, rows));
        const double gain = level.gain[b] - 1.0, place = level.mean_dn * (level.light[b] - 1.0);
        if (pass == 0) {
          line.weight += weight;
          line.gain += weight * gain;
          line.place += weight * place;
          line.own_error2 += weight * weight * own;
        } else {
          line.square_of_place += weight * (place - line.place) * (place - line.place);
          line.product += weight * (place - line.place) * (gain - line.gain);
        }
      }
    for (BlockLine& line : lines)
      if (pass == 0 && line.weight > 0) {
        line.gain /= line.weight;
        line.place /= line.weight;
        line.own_error2 /= line.weight * line.weight;
      }
  }
  return lines;
}

// Products of x and y by the inverse of the gains' covariance but for the bend's part of it. Those
// of one row of blocks share an error: it is diagonal but for the product of two vectors (Sherman
// and Morrison).
double product_of(const std::vector<double>& x, const std::vector<double>& y,
                  const std::vector<BlockLine>& lines) {
  double product = 0;
  for (std::size_t b = 0; b < kBlocks; b += kAcross) {
    double own_product = 0, shared_x = 0, shared_y = 0, shared2 = 0;
    for (std::size_t i = b; i < b + kAcross; ++i) {
      const double own = lines[i].own_error2,
                   shared = std::sqrt(std::max(1.0 / lines[i].weight - own, 0.0));
      own_product += x[i] * y[i] / own;
      shared_x += shared * x[i] / own;
      shared_y += shared * y[i] / own;
      shared2 += shared * shared / own;
    }
    product += own_product - shared_x * shared_y / (1.0 + shared2);
  }
  return product;
}

// χ² of gains less the bend's, whose error is one of all blocks, by their places: the covariance of
// above and the product of two vectors more. Taken for one of each block it gave healthy cameras a
// gain that differs over the frame, six times in a thousand gains of a few bright levels.
double chi_square_of(const std::vector<double>& gain, const std::vector<BlockLine>& lines,
                     double bend_variance) {
  std::vector<double> place;
  for (const BlockLine& line : lines) place.push_back(line.place);
  const double across = product_of(gain, place, lines);
  return product_of(gain, gain, lines) -
         bend_variance * across * across / (1.0 + bend_variance * product_of(place, place, lines));
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
    out.light_variance_dn2 += (variance - dark) / channels;
  }
  out.frames = flat.frames();
  for (double& e : error) e = std::sqrt(e);
  out.gain = std::move(gain);
  out.light = std::move(light);
  out.gain_stderr = std::move(error);
  return out;
}

void warn_of_gain_map(const std::vector<GainBlocks>& levels, const RowsOfFrame& rows,
                      PhysicsCalibration& out) {
  constexpr double kLeast = 0.03, kDeviations = 5.2;
  const std::vector<BlockLine> lines = block_lines(levels, rows);
  double square = 0, product = 0;
  for (const BlockLine& line : lines) {
    if (!(line.weight > 0)) return;
    square += line.square_of_place;
    product += line.product;
  }
  const double bend = square > 0 ? product / square : 0.0,
               bend_variance = square > 0 ? 1.0 / square : 0.0;
  std::vector<double> gain, light(kBlocks, 0.0);
  double used = 0;
  for (const BlockLine& line : lines) gain.push_back(line.gain - bend * line.place);
  const double chi_square = chi_square_of(gain, lines, bend_variance);
  for (const GainBlocks& level : levels)
    for (std::size_t b = 0; b < level.light.size(); ++b) light[b] += level.light[b];
  for (const GainBlocks& level : levels) used += level.light.empty() ? 0 : 1;
  const auto [low, high] = std::minmax_element(gain.begin(), gain.end());
  const auto [dim, bright] = std::minmax_element(light.begin(), light.end());
  const double deviations = chi_square_deviate(chi_square / kBlocks, kBlocks);
  if (!(*high - *low > kLeast) || !(deviations > kDeviations)) return;
  out.warnings.push_back(fmt::format(
      "K differs by {:.0f} % over the frame, the light by {:.0f} %: a flat-field or shading "
      "correction in the camera multiplies the pixels (turn it off), or parts of the sensor have "
      "gains of their own; the model has one K",
      100 * (*high - *low), 100 * (*bright - *dim) / used));
}

}  // namespace malus
