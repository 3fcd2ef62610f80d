// The noise of a single picture, for when there is no model: how the variance of each channel rises
// with the signal, and the row noise.
//
// Pixel noise: diagonal second differences of 2x2 pixels of one channel (offsets of rows and
// columns and linear shading cancel) over blocks of 8x8 pixels of the channel. Per level of
// brightness the blocks that are smoothest at a coarser scale, which the noise of the differences
// does not affect, vote by a robust deviation; a line is fitted through the levels. Idea: Pyatykh,
// Hesser, Zheng, "Image noise level estimation by principal component analysis", IEEE TIP 22(2),
// 2013, and Foi, Trimeche, Katkovnik, Egiazarian, "Practical Poissonian-Gaussian noise modeling and
// fitting for single-image raw-data", IEEE TIP 17(10), 2008; accuracy: docs/noise-estimate.md.
// Areas that show none (noiseless_areas.h) take no part, nor do pixels that hold no light
// (light_range). What a picture cannot tell: the bias (taken as 0), and noise that earlier
// processing has coloured.
#pragma once

#include "malus/base/estimate.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <string>
#include <string_view>

namespace malus {

inline constexpr int kNoiseBlock = 8;         ///< pixels of a channel per side of a block
inline constexpr int kLeastNoiseBlocks = 64;  ///< per channel

/// What no estimate from one picture can tell, for those who are told of one.
inline constexpr std::string_view kPictureNoiseLimits =
    "noise estimated from a picture is too high where texture is as fine as the pixels and too low "
    "where the picture was smoothed, and what dark pixels have above black counts as light";

struct PictureNoise {
  NoiseProfile profile;  ///< estimated_from_picture is set
  /// Of the deviation at the mean signal, one standard error: of sampling, and where much texture
  /// was left out, or a result lowered the noise, up to a fifth for that.
  double relative_error = 0;
  int levels = 0;           ///< of brightness that carry the fit, mean over the channels
  double smooth_share = 0;  ///< of the blocks: how much of the picture could be used
  /// Of what looked like noise over all levels of brightness, left out of it (noise_floor.h). Of a
  /// small picture of one brightness it may be chance: trust tells what is left out at the mean.
  double texture_share = 0;
  double left_out = 0;      ///< the same of the variance at the mean signals; 0 where it is little
  double deviation_dn = 0;  ///< of the noise at the mean signals, mean over the channels
  /// What variances were multiplied by because a result with more noise contradicted them.
  double result_share = 1;
  std::string trust;  ///< one sentence with the numbers
};

/// How long texture is looked through for noise: kQuick leaves out the smooth patches between it
/// (quiet_patches.h), which take most of the time and can only lower the estimate.
enum class TextureSearch { kQuick, kWhole };

/// Undecided when the picture is too small (fewer than 64 blocks per channel), or has no noise (a
/// constant or synthetic picture). Throws InputError as require_levels (image/black_levels.h).
Estimate<PictureNoise> estimate_profile(const RawFrame& frame,
                                        TextureSearch search = TextureSearch::kWhole);

/// Whether estimate_profile is undecided because the picture, which is large enough, has no noise.
/// Throws InputError as it does.
bool is_without_noise(const RawFrame& frame);

/// estimate_profile for callers that cannot go on without it, with a second look: the middle of the
/// frame is denoised (512x512 pixels at most where texture was left out, else 256x256), and noise
/// that its result contradicts is lowered. Throws InputError where nothing is decided, with the
/// reason, on a frame without pixels and on a white that check_frame refuses; remedy: what the
/// caller's user can do.
PictureNoise require_estimate(const RawFrame& frame, std::string_view remedy);

}  // namespace malus
