#include "malus/denoise/estimate_noise.h"

#include "malus/base/chi_square.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/denoise/cut_off.h"
#include "malus/denoise/internal/noiseless_areas.h"
#include "malus/denoise/internal/second_look.h"
#include "malus/denoise/internal/texture_removal.h"
#include "malus/denoise/internal/variance_lines.h"
#include "malus/denoise/prepared_frame.h"
#include "malus/denoise/row_noise.h"
#include "malus/denoise/saturated_pixels.h"
#include "malus/image/black_levels.h"
#include "malus/image/digital_gain.h"
#include "malus/image/pack.h"
#include "malus/image/quantization.h"
#include "malus/noise/clipped_noise.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

using internal::VarianceLevel;
using internal::VarianceLines;

constexpr int kBlock = kNoiseBlock;
constexpr std::size_t kMostLevels = 16;
constexpr std::size_t kLeastPerLevel = 24;
// Two levels of a small frame cannot tell how the noise rises with the signal.
constexpr std::size_t kLeastLevels = 4;
constexpr double kSmoothShare = 0.4;  // of a level's blocks
constexpr double kMuchTexture = 0.2;  // of what looked like noise
// Of the deviation, where next to all that looked like noise was texture: foliage, print and codes
// (docs/noise-estimate.md).
constexpr double kErrorOfTexture = 0.2;

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

std::vector<Block> measure_blocks(View<const float> plane, double saturated_dn) {
  std::vector<Block> blocks;
  Block block;
  for (int r = 0; r + kBlock <= plane.rows(); r += kBlock)
    for (int c = 0; c + kBlock <= plane.cols(); c += kBlock)
      if (measure_block(plane, r, c, saturated_dn, block)) blocks.push_back(block);
  return blocks;
}

// The smoothest blocks of a run of blocks with similar means.
VarianceLevel measure_level(std::vector<Block> blocks) {
  std::sort(blocks.begin(), blocks.end(),
            [](const Block& a, const Block& b) { return a.texture < b.texture; });
  const auto count =
      static_cast<std::size_t>(std::ceil(kSmoothShare * static_cast<double>(blocks.size())));
  blocks.resize(count);
  std::vector<double> variances;
  for (const Block& block : blocks) variances.push_back(block.variance);
  // Blocks whose details still hold texture lie far above the median: they are clipped. The median
  // of a mean of 16 squares is below its expectation.
  constexpr double kDegrees = kBlock * kBlock / 4.0;
  const double center = median_of(variances) / chi_square_ratio(0.0, kDegrees);
  const double spread = center * std::sqrt(2.0 / kDegrees);
  // The signal is theirs alone too: a level may hold dark blocks and bright ones.
  double variance = 0, signal = 0;
  int kept = 0;
  for (const Block& block : blocks)
    if (block.variance <= center + 4 * spread) {
      variance += block.variance;
      signal += block.mean;
      ++kept;
    }
  return {signal / kept, variance / kept, std::sqrt(2.0 / kDegrees / kept)};
}

std::vector<VarianceLevel> measure_levels(std::vector<Block> blocks) {
  std::sort(blocks.begin(), blocks.end(),
            [](const Block& a, const Block& b) { return a.mean < b.mean; });
  const std::size_t levels =
      std::clamp<std::size_t>(blocks.size() / kLeastPerLevel, kLeastLevels, kMostLevels);
  std::vector<VarianceLevel> result;
  for (std::size_t i = 0; i < levels; ++i)
    result.push_back(measure_level(
        {blocks.begin() + static_cast<std::ptrdiff_t>(i * blocks.size() / levels),
         blocks.begin() + static_cast<std::ptrdiff_t>((i + 1) * blocks.size() / levels)}));
  return result;
}

// What the levels of a channel would be if its noise were not cut off at floor_dn: they are smooth,
// so noise is all that spreads their pixels. Noise of less than half a step is not that of a normal
// deviate any more.
void undo_cut_off(double floor_dn, double step_dn, std::vector<VarianceLevel>& levels) {
  const double least_dn2 = step_dn * step_dn * (0.25 + 1.0 / 12);
  for (VarianceLevel& level : levels) {
    const MeanAndVariance before =
        moments_before_clipping({level.signal, level.variance}, {floor_dn, step_dn});
    if (before.variance_dn2 < least_dn2) continue;
    level.relative_error *= std::sqrt(before.variance_dn2 / level.variance);
    level.signal = before.mean_dn;
    level.variance = before.variance_dn2;
  }
}

double mean_signal(const std::vector<Block>& blocks) {
  double sum = 0;
  for (const Block& b : blocks) sum += b.mean;
  return sum / static_cast<double>(std::max<std::size_t>(blocks.size(), 1));
}

std::string trust_statement(const PictureNoise& noise) {
  std::string text = fmt::format(
      "noise estimated from the picture itself: deviation {:.2f} DN at its mean signal, ±{:.0f} % "
      "by sampling{}, from {:.0f} % of the picture and {} levels of brightness",
      noise.deviation_dn, std::max(100 * noise.relative_error, 1.0),
      noise.left_out > 0 || noise.result_share < 1 ? " and texture" : "", 100 * noise.smooth_share,
      noise.levels);
  if (noise.left_out > 0)
    text += fmt::format(
        "; {:.0f} % of what looked like noise can be told from neighbouring pixels: it is texture "
        "and was left out; finer texture was not, so the result may be blurred and too bright",
        100 * noise.left_out);
  if (noise.result_share < 1)
    text += fmt::format("; a first result left {:.0f} % of the variance found, so it was lowered",
                        100 * noise.result_share);
  return text;
}

// A white level in the wrong scale is the usual cause.
std::string too_few_blocks(std::size_t blocks, const Image& plane, double range_dn) {
  constexpr double kManyWhite = 0.2;
  const auto& values = plane.values();
  const auto white =
      std::count_if(values.begin(), values.end(), [&](float v) { return v >= range_dn; });
  const double share = static_cast<double>(white) / static_cast<double>(values.size());
  return fmt::format("{} of {} x {} pixels per channel, {} are needed",
                     counted(std::int64_t(blocks), "unsaturated block"), kBlock, kBlock,
                     kLeastNoiseBlocks) +
         (share > kManyWhite
              ? fmt::format("; {} % of the pixels are at white or above it: is {} right?",
                            percent_text(share), setting("white"))
              : "");
}

// What the planes tell, before texture is taken off.
struct PlanesNoise {
  VarianceLines channels;
  std::vector<double> mean_dn;      ///< of the usable blocks, above black
  std::vector<float> saturated_dn;  ///< above black
  int levels = 0;                   ///< of all channels together
  double smooth_share = 0;
  bool has_noise = false;  ///< beyond what rounding in computing makes
};

// Above black. What tells nothing of the noise is no number.
Planes planes_above_black(const RawFrame& frame, const std::vector<float>& piles_dn) {
  std::vector<float> saturated_dn;
  for (const float pile_dn : piles_dn)
    saturated_dn.push_back(std::min(pile_dn, static_cast<float>(frame.white_dn)));
  const std::vector<bool> is_noiseless = noiseless_areas(frame.dn, frame.layout, saturated_dn);
  Image without;
  if (!is_noiseless.empty()) {
    without = frame.dn;
    for (std::size_t p = 0; p < is_noiseless.size(); ++p)
      if (is_noiseless[p]) without.values()[p] = std::numeric_limits<float>::quiet_NaN();
  }
  Planes planes = pack(is_noiseless.empty() ? frame.dn : without, frame.layout);
  for (int k = 0; k < planes.channels(); ++k)
    for (float& v : planes[k].values())
      v -= static_cast<float>(frame.black_dn[static_cast<std::size_t>(k)]);
  return planes;
}

// Digital gains of the channels over the least of them; empty where the codes tell none, or the
// noise does not bear them out.
std::vector<double> gains_of(const Planes& planes, const VarianceLines& channels, double step_dn) {
  constexpr std::size_t kPixels = 1 << 16;
  std::vector<double> gains;
  for (const Image& plane : planes) {
    const std::vector<float>& all = plane.values();
    std::vector<float> some;
    const std::size_t stride = all.size() / kPixels + 1;
    for (std::size_t i = 0; i < all.size(); i += stride) some.push_back(all[i]);
    gains.push_back(digital_gain(some, step_dn));
  }
  const auto [least, most] = std::minmax_element(gains.begin(), gains.end());
  if (*least == *most) return {};
  const double lowest = *least;
  for (double& gain : gains) gain /= lowest;
  return channels.agree_without(gains) ? gains : std::vector<double>{};
}

// planes: DN above black. piles_dn: of the frame's channels (saturated_pixels.h).
Estimate<PlanesNoise> measure_planes(const Planes& planes, const RawFrame& frame,
                                     const std::vector<float>& piles_dn, double step_dn) {
  const double range_dn = white_above_black(frame.white_dn, frame.black_dn);
  const CutOff cut_off = measure_cut_off(frame);
  PlanesNoise out;
  out.channels.rounding_dn2 = step_dn * step_dn / 12;
  double usable = 0, all = 0;
  for (const Image& plane : planes) {
    const std::size_t k = out.channels.levels.size();
    const float pile_dn = piles_dn[k] - static_cast<float>(frame.black_dn[k]);  // as the pixels
    out.saturated_dn.push_back(std::min(pile_dn, static_cast<float>(range_dn)));
    const std::vector<Block> blocks = measure_blocks(plane, out.saturated_dn.back());
    if (blocks.size() < kLeastNoiseBlocks)
      return Undecided{too_few_blocks(blocks.size(), plane, range_dn)};
    usable += kSmoothShare * static_cast<double>(blocks.size());
    all += static_cast<double>(plane.rows() / kBlock) * (plane.cols() / kBlock);
    std::vector<VarianceLevel> levels = measure_levels(blocks);
    const bool cut = cut_off.share[k] > 0;
    out.channels.floor_dn.push_back(cut ? -frame.black_dn[k]
                                        : -std::numeric_limits<double>::infinity());
    if (cut) undo_cut_off(out.channels.floor_dn[k], step_dn, levels);
    out.channels.add(std::move(levels), frame.black_known);
    out.mean_dn.push_back(mean_signal(blocks));
    out.levels += static_cast<int>(out.channels.levels.back().size());
  }
  out.channels.gains = gains_of(planes, out.channels, step_dn);
  out.has_noise = std::sqrt(out.channels.highest_variance) > 1e-6 * std::max(range_dn, 1e-30);
  out.smooth_share = usable / all;
  return out;
}

// At the channels' mean signals, mean over the channels.
double deviation_dn_of(const PlanesNoise& measured) {
  double sum = 0;
  const std::vector<VarianceCurve> curves = measured.channels.curves(1.0);
  for (std::size_t k = 0; k < curves.size(); ++k) sum += std::sqrt(curves[k](measured.mean_dn[k]));
  return sum / static_cast<double>(curves.size());
}

// The channels' variances, the deviation at their mean signals and its error.
void fill_channels(const PlanesNoise& measured, PictureNoise& noise) {
  const VarianceLines& channels = measured.channels;
  const std::vector<VarianceCurve> curves = channels.curves(1.0);
  const double share = 1.0 / static_cast<double>(channels.lines.size());
  for (std::size_t k = 0; k < channels.lines.size(); ++k) {
    ChannelProfile channel;
    channel.variance = curves[k];
    const double variance = channel.variance(measured.mean_dn[k]);
    noise.deviation_dn += share * std::sqrt(variance);
    noise.relative_error +=
        variance > 0 ? share * 0.5 / (std::sqrt(channels.weights[k]) * variance) : 0;
    noise.profile.channels.push_back(channel);
  }
}

// Of a frame whose pixels hold light, or are NaN.
Estimate<PictureNoise> noise_of_light(const RawFrame& frame, TextureSearch search) {
  // White may lie lower than what is told, and is not known of many frames.
  const std::vector<float> piles_dn = piled_up_dn(frame.dn, frame.layout);
  Planes planes = planes_above_black(frame, piles_dn);
  PictureNoise noise;
  noise.profile.layout = frame.layout;
  noise.profile.estimated_from_picture = true;
  noise.profile.step_dn = quantization_step(frame.dn);
  const Estimate<PlanesNoise> found =
      measure_planes(planes, frame, piles_dn, noise.profile.step_dn);
  if (!found) return Undecided{found.reason()};
  if (!found->has_noise) return Undecided{"the picture has no noise that could be measured"};
  PlanesNoise measured = *found;
  Image dn(frame.dn.rows(), frame.dn.cols());
  unpack(planes, frame.layout, dn);
  planes = {};
  measured.channels.settle();
  const double seeming_dn = deviation_dn_of(measured);
  noise.texture_share = internal::take_texture_off(
      dn, frame.layout, measured.saturated_dn, search == TextureSearch::kWhole, measured.channels);
  noise.levels = measured.levels / frame.layout.channels();
  noise.smooth_share = measured.smooth_share;
  fill_channels(measured, noise);
  estimate_row_deviation(dn, measured.saturated_dn, noise.profile);
  // Through levels of nearly one brightness lines are unsteady everywhere else, and texture_share
  // with them.
  noise.left_out = 1 - std::pow(noise.deviation_dn / seeming_dn, 2);
  if (!(std::min(noise.left_out, noise.texture_share) > kMuchTexture)) noise.left_out = 0;
  noise.relative_error = std::hypot(noise.relative_error, kErrorOfTexture * noise.left_out);
  noise.trust = trust_statement(noise);
  return noise;
}

// Where texture was told from noise some of it may have stayed; elsewhere all may have. Residuals
// do not tell of noise that is less than a code.
PictureNoise looked_at_again(const RawFrame& frame, PictureNoise noise) {
  if (noise.deviation_dn < noise.profile.step_dn) return noise;
  const std::optional<double> share = internal::share_that_result_shows(
      frame, noise.profile, noise.left_out > 0 ? internal::Look::kWhole : internal::Look::kGlance);
  if (!share) return noise;
  noise.profile = internal::with_scaled_variances(std::move(noise.profile), *share);
  noise.deviation_dn = std::sqrt(*share * std::pow(noise.deviation_dn, 2) +
                                 internal::kept_rounding_dn2(noise.profile, *share));
  noise.result_share = *share;
  noise.relative_error = std::hypot(noise.relative_error, kErrorOfTexture * (1 - *share));
  noise.trust = trust_statement(noise);
  return noise;
}

// The frame with NaN for pixels that hold no light; none where all do.
std::optional<RawFrame> cleaned(const RawFrame& frame) {
  const LightRange light = light_range(frame);
  const auto holds_none = [&](float dn) { return !std::isnan(dn) && !light.holds(dn); };
  const auto& pixels = frame.dn.values();
  if (std::none_of(pixels.begin(), pixels.end(), holds_none)) return std::nullopt;
  std::optional<RawFrame> copy = frame;
  std::replace_if(copy->dn.values().begin(), copy->dn.values().end(), holds_none,
                  std::numeric_limits<float>::quiet_NaN());
  return copy;
}

}  // namespace

Estimate<PictureNoise> estimate_profile(const RawFrame& frame, TextureSearch search) {
  require_levels(frame);
  const std::optional<RawFrame> copy = cleaned(frame);
  return noise_of_light(copy ? *copy : frame, search);
}

bool is_without_noise(const RawFrame& frame) {
  require_levels(frame);
  const std::optional<RawFrame> copy = cleaned(frame);
  const RawFrame& light = copy ? *copy : frame;
  const std::vector<float> piles_dn = piled_up_dn(light.dn, light.layout);
  const Estimate<PlanesNoise> found = measure_planes(planes_above_black(light, piles_dn), light,
                                                     piles_dn, quantization_step(light.dn));
  return found && !found->has_noise;
}

PictureNoise require_estimate(const RawFrame& frame, std::string_view remedy) {
  require_pixels(frame);
  const Estimate<PictureNoise> noise = estimate_profile(frame);
  if (!noise)
    throw InputError(frame.source.empty() ? "the picture" : frame.source,
                     "its noise cannot be estimated: " + noise.reason(), std::string(remedy));
  return looked_at_again(frame, *noise);
}

}  // namespace malus
