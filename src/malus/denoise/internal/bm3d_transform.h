// The 8-point transforms and the window of BM3D as plain matrices: the definition that the fast
// code is tested against. What the fast code's unscaled transforms are scaled by.
#pragma once

#include "malus/denoise/internal/bm3d_parameters.h"

#include <array>
#include <cmath>
#include <numbers>

namespace malus::internal {

using Matrix8 = std::array<std::array<double, kPatch>, kPatch>;  ///< [coefficient][sample]

/// Orthonormal DCT-II.
inline Matrix8 dct_matrix() {
  Matrix8 m{};
  for (int k = 0; k < kPatch; ++k)
    for (int n = 0; n < kPatch; ++n)
      m[k][n] = std::sqrt((k == 0 ? 1.0 : 2.0) / kPatch) *
                std::cos(std::numbers::pi * k * (2 * n + 1) / (2.0 * kPatch));
  return m;
}

/// Correction of the averages by the neighbouring details in the biorthogonal wavelet 1.5: the
/// outer taps 0.12146... of its low pass over sqrt(1/2) = 22/128. The outermost taps (3/128) cancel
/// in a periodic signal of four pairs. Cohen, Daubechies, Feauveau, Comm. Pure Appl. Math. 45,
/// 1992, table 6.1 (N = 1, Ñ = 5).
inline constexpr double kBiorthogonalCorrection = 22.0 / 128.0;

/// Biorthogonal 1.5, three periodic levels on eight samples: [0] the average, [1] the coarsest
/// detail, [2..3] the middle ones, [4..7] the finest. Every level is scaled by sqrt(1/2).
inline Matrix8 biorthogonal_matrix() {
  const double h = std::sqrt(0.5);
  Matrix8 m{};
  std::array<std::array<double, kPatch>, 4> average{}, detail{};
  for (int k = 0; k < 4; ++k) {
    average[k][2 * k] = average[k][2 * k + 1] = h;
    detail[k][2 * k] = h;
    detail[k][2 * k + 1] = -h;
  }
  auto corrected = average;
  for (int k = 0; k < 4; ++k)
    for (int n = 0; n < kPatch; ++n)
      corrected[k][n] +=
          kBiorthogonalCorrection * (detail[(k + 1) % 4][n] - detail[(k + 3) % 4][n]);
  for (int n = 0; n < kPatch; ++n) {
    const double low0 = h * (corrected[0][n] + corrected[1][n]);
    const double low1 = h * (corrected[2][n] + corrected[3][n]);
    m[0][n] = h * (low0 + low1);
    m[1][n] = h * (low0 - low1);
    m[2][n] = h * (corrected[0][n] - corrected[1][n]);
    m[3][n] = h * (corrected[2][n] - corrected[3][n]);
    for (int k = 0; k < 4; ++k) m[4 + k][n] = detail[k][n];
  }
  return m;
}

/// Its inverse: the details leave the averages first, then plain Haar backwards.
inline Matrix8 biorthogonal_inverse() {
  const double h = std::sqrt(0.5);
  Matrix8 m{};  // [sample][coefficient]
  for (int c = 0; c < kPatch; ++c) {
    std::array<double, kPatch> x{};
    x[c] = 1;
    const double low0 = h * (x[0] + x[1]), low1 = h * (x[0] - x[1]);
    std::array<double, 4> average = {h * (low0 + x[2]), h * (low0 - x[2]), h * (low1 + x[3]),
                                     h * (low1 - x[3])};
    for (int k = 0; k < 4; ++k) {
      average[k] -= kBiorthogonalCorrection * (x[4 + (k + 1) % 4] - x[4 + (k + 3) % 4]);
      m[2 * k][c] = h * (average[k] + x[4 + k]);
      m[2 * k + 1][c] = h * (average[k] - x[4 + k]);
    }
  }
  return m;
}

enum class BlockTransform { biorthogonal, dct };

/// Unscaled coefficient * norm = coefficient of the matrix. DCT: Arai et al.; the biorthogonal
/// transform has sqrt(1/2) per level.
inline std::array<double, kPatch> transform_norms(BlockTransform transform) {
  if (transform == BlockTransform::biorthogonal) {
    const double finest = std::sqrt(0.5), coarsest = std::sqrt(0.125);
    return {coarsest, coarsest, 0.5, 0.5, finest, finest, finest, finest};
  }
  std::array<double, kPatch> norm{};
  for (int k = 0; k < kPatch; ++k)
    norm[static_cast<std::size_t>(k)] =
        1 / (std::sqrt(8.0) * (k == 0 ? 1 : std::sqrt(2.0) * std::cos(k * std::numbers::pi / 16)));
  return norm;
}

/// What unscaled coefficients are multiplied by before the fast inverse transform: powers of two.
inline std::array<double, kPatch> transform_back(BlockTransform transform) {
  std::array<double, kPatch> back{};
  back.fill(1.0 / kPatch);
  if (transform == BlockTransform::biorthogonal)
    back = {0.125, 0.125, 0.25, 0.25, 0.5, 0.5, 0.5, 0.5};
  return back;
}

/// Kaiser window over eight samples, β = 2; blocks are aggregated with its outer product.
inline std::array<double, kPatch> kaiser_window() {
  std::array<double, kPatch> w{};
  for (int n = 0; n < kPatch; ++n) {
    const double t = 2.0 * n / (kPatch - 1) - 1;
    w[n] = std::cyl_bessel_i(0.0, 2.0 * std::sqrt(1 - t * t)) / std::cyl_bessel_i(0.0, 2.0);
  }
  return w;
}

}  // namespace malus::internal
