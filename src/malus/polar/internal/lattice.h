// Samples of one kind on a regular lattice inside a full-resolution picture, and how to fill the
// gaps between them.
#pragma once

#include "malus/base/parallel.h"
#include "malus/image/view.h"

#include <algorithm>

namespace malus::internal {

/// body(row) in parallel.
template <class Function>
void for_rows(int rows, const Function& body) {
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) body(r);
  });
}

/// Positions (row + i stride, col + j stride) of a picture.
struct Lattice {
  int row = 0, col = 0, stride = 2;
};

/// The picture's samples on the lattice; at least one row and column must lie inside.
Image sampled(View<const float> full, const Lattice& lattice);

/// Bilinear interpolation to rows x cols; constant beyond the outermost samples.
Image upsampled(const Image& coarse, const Lattice& lattice, int rows, int cols);

/// Mean over (2 radius + 1)² pixels, fewer at the border.
Image box_mean(const Image& image, int radius);

/// A position at most size - 1 beyond the border, mirrored at the outermost pixel.
inline int mirrored(int x, int size) {
  if (size == 1) return 0;
  if (x < 0) x = -x;
  return x < size ? x : 2 * (size - 1) - x;
}

/// An interpolated value, not below 0.7 of the least sample around it. Next to a bright area what
/// is added to interpolated samples can exceed them: a dark area's S0 came out negative. Brighter
/// values need no limit, and 0.7 leaves thin dark lines their depth; so pictures keep their quality
/// (docs/polarization.md). No limit where a sample is below 0: in noise around black it would raise
/// the mean.
inline float not_far_below(float least_sample, float value) {
  constexpr float kShare = 0.7f;
  return least_sample >= 0 ? std::max(value, kShare * least_sample) : value;
}

/// Separable [1 2 1]²/16, mirrored at the border.
Image smoothed(const Image& image);

/// Residual interpolation with a guided filter's slope (Kiku, Monno, Tanaka, Okutomi, "Residual
/// interpolation for color image demosaicking", ICIP 2013; slopes averaged with weights as in their
/// minimized-Laplacian follow-ups). The samples y follow the guide with a local slope a:
///   out = up(y) + a (guide - up(guide at the samples)).
/// The guided filter's offset cancels against the residual's. epsilon: variance of the guide below
/// which it is not trusted, in its unit squared. The result is not far below the 4x4 samples around
/// it (not_far_below).
Image guided_upsampled(const Image& samples, const Lattice& lattice, const Image& guide,
                       double epsilon);

}  // namespace malus::internal
