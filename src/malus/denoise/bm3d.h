// BM3D: denoising by block matching and collaborative filtering of white noise of known deviation.
// Dabov, Foi, Katkovnik, Egiazarian, "Image denoising by sparse 3-D transform-domain collaborative
// filtering", IEEE Trans. Image Processing 16(8), 2007; parameters started from Lebrun, "An
// analysis and implementation of the BM3D image denoising method", Image Processing On Line 2,
// 2012. What differs from both, and what each difference earns, is in docs/bm3d.md.
#pragma once

#include "malus/base/parameter.h"
#include "malus/base/progress.h"
#include "malus/denoise/denoise_profile.h"
#include "malus/image/view.h"

#include <span>
#include <string>

namespace malus {

struct Bm3dSettings {
  std::string profile = "normal";

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.profile, ParameterInfo{.name = "profile",
                                      .unit = "",
                                      .help = "speed against quality",
                                      .choices = denoise_profile_names()});
  }
};

/// How far an output pixel looks, for callers that cut a large picture into tiles.
struct Bm3dReach {
  int pixels;  ///< an output pixel depends on no input further away, in rows or in columns
  int grid;  ///< a tile whose origin is a multiple of this, with `pixels` of context on every side
             ///< that is not the picture's own border, gives the whole picture's values
};
/// Throws InputError on an unknown profile.
Bm3dReach bm3d_reach(const Bm3dSettings& settings);

/// Denoises planes of any equal size (1x1 and up) jointly: block matches are found once, on the
/// channels in match_weights, and shared by all channels; each channel is filtered with its own
/// sigma.
/// - noisy: finite values in any unit; the noise is white, Gaussian, independent of the signal.
/// - sigma: noise deviation, one per channel, in the unit of its plane; a channel with sigma 0
/// comes
///   back unchanged and takes no part in the matching.
/// - match_weights: one per channel, >= 0: weight of the channel's squared distance in units of its
///   noise variance; empty = equal weights.
/// - variance_out: when given, receives the expected squared error per pixel (unit of the plane,
///   squared). Measured on natural pictures, its mean is right within about a third for noise above
///   2 % of the range (docs/bm3d.md).
/// The same bytes for any thread count. Constant planes come back exactly. Throws InputError on an
/// unknown profile, Cancelled when progress asks for a stop. Contract: sizes agree, sigma finite
/// and >= 0.
Planes bm3d(const Planes& noisy, std::span<const float> sigma, const Bm3dSettings& settings,
            std::span<const float> match_weights = {}, Progress& progress = silent_progress(),
            Planes* variance_out = nullptr);

}  // namespace malus
