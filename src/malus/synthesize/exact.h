// The plain definition of the physics noise (000 Eq. 1-4), one pixel at a time in double precision.
// Everything faster is compared with this.
//
//   D = K Poisson(s / K) + mu + TukeyLambda(lambda, sigma_TL) + sigma_b z(row group) + U(-q/2, q/2)
//
// z is drawn anew for every row group, or drifts slowly from group to group (noise/row_drift.h).
//
// s is the clean pixel in DN above black, and so is D. Nothing is rounded or clamped: that is the
// camera's last step (round_as_camera in synthesizer.h); where it rounds, rounding is the
// quantisation noise.
#pragma once

#include "malus/image/view.h"
#include "malus/noise/physics.h"

#include <cstdint>
#include <vector>

namespace malus {

/// Which frame's noise to draw, and where a view lies in that frame. Every random number is a
/// function of (seed, frame, row, column): crops and tiles get the noise that the whole frame would
/// get at their place.
struct DrawAddress {
  std::uint64_t seed = 0;
  std::uint32_t frame = 0;
  int row0 = 0, col0 = 0;  ///< mosaic position of the view's first pixel; require_place
};

/// Last row and column of a mosaic, far beyond any sensor's: places count on from the view's first
/// pixel in int, by whole groups of columns.
inline constexpr int kLastPosition = (1 << 30) - 1;

/// The start of `size` rows or columns that lie from 0 to kLastPosition. Throws InputError, naming
/// `name`, of another one.
int require_place(const char* name, std::int64_t start, int size);
/// Of a view's rows and columns.
void require_place(const DrawAddress& address, int rows, int cols);

/// Throws InputError where parameters cannot be drawn with: a channel too many or too few, K not
/// positive, lambda outside (-0.5, 8], a negative sigma, anything not finite, row_group < 1.
void check_physics(const PhysicsNoise& noise);

/// The standard normal draw of a row group; groups before the frame's first have negative numbers.
double row_group_draw(const DrawAddress& address, std::int64_t group);

/// z of mosaic rows address.row0, row0 + 1, ..., equal inside a row group and shared by all
/// channels in it, each of which scales it by its own sigma_b: the groups' draws weighted with
/// row_kernel(). White rows get the draws themselves. Same values for any row0 and number of rows
/// that hold a row.
std::vector<double> row_deviates(const DrawAddress& address, int rows, int row_group,
                                 const RowDrift& drift);

/// One pixel without its row term. signal_dn <= 0 has no shot noise and keeps its (negative) value;
/// NaN and infinities stay what they are.
double draw_pixel_exact(const PhysicsNoise& noise, int channel, double signal_dn,
                        const DrawAddress& address, int row, int col);

/// A whole view, mosaic order by noise.layout, channel of pixel (r, c) that of
/// (row0 + r, col0 + c). Contract: equal sizes; noisy_dn may be clean_dn. Throws InputError as
/// check_physics and require_place do. Runs on all threads, same bytes for any number of them.
void add_noise_exact(const PhysicsNoise& noise, View<const float> clean_dn, View<float> noisy_dn,
                     const DrawAddress& address);

}  // namespace malus
