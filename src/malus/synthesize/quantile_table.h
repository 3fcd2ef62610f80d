// Quantile functions as tables that a sampler reads with one uniform word per draw.
//
// A word splits into a sign (its highest bit: 1 = upper half) and 31 bits v that say how deep in
// its tail the draw lies: p = (v + 1/2) 2^-32, 0 < p < 1/2. With x = v + 1/2 as a float, the
// exponent of x and the next 6 bits number the cell, so every octave of p down to 2^-33 has 64
// cells, and the cell holds the line a + b x that is closest to the quantile function in the mean
// square. A line's residual then has no mean and no slope over its cell: mean and variance of the
// draws are those of the true distribution up to the square of the residual.
//
// Accuracy, tested: |error| < 4e-5 scale units for Tukey-lambda with |lambda| <= 0.3 and for the
// normal distribution down to p = 1e-6 (1e-4 relative in the tails below that).
#pragma once

#include <cstdint>
#include <functional>
#include <vector>

namespace malus {

inline constexpr int kTailCellBits = 6;                ///< cells per octave, as a power of two
inline constexpr int kTailShift = 23 - kTailCellBits;  ///< float bits below the cell number
inline constexpr std::uint32_t kTailFirst = 0x3F000000u >> kTailShift;  ///< cell of x = 1/2
/// 32 octaves and the one cell that x = 2^31 falls into after rounding.
inline constexpr int kTailCells = (32 << kTailCellBits) + 1;

/// a + b x on one cell, x = p 2^32.
struct TailLine {
  float a, b;
};

/// Lines of the upper quantile function p -> Q(1 - p) for p in (0, 1/2]; kTailCells of them.
/// upper_quantile: finite and monotone there; called 2 * kTailCells times.
std::vector<TailLine> tail_lines(const std::function<double(double p)>& upper_quantile);

/// The same for the Tukey-lambda distribution of scale 1, appended to `lines`: equal to tail_lines
/// of its quantile function up to the rounding of a float, eight times faster. -0.5 < lambda <= 8.
void append_tukey_lambda_lines(double lambda, std::vector<TailLine>& lines);

/// The standard normal distribution's lines; made once.
const std::vector<TailLine>& normal_tail_lines();

}  // namespace malus
