#include "malus/synthesize/quantile_table.h"

#include "malus/base/random.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>

namespace malus {
namespace {

constexpr int kOctaves = 32, kCellsPerOctave = 1 << kTailCellBits;
constexpr int kPointsPerOctave = 2 * kCellsPerOctave;  // starts and middles of the cells

// First x of a cell; x of the words before 1/2 does not occur.
double cell_start(int cell) {
  return static_cast<double>(
      std::bit_cast<float>((kTailFirst + static_cast<std::uint32_t>(cell)) << kTailShift));
}

// Mean-square projection of the parabola through the values at a cell's start, middle and end: its
// slope is the chord's, its middle lies a third of the way from the curve to the chord.
TailLine projected(double middle_x, double cells_per_x, double left, double middle, double right) {
  const double slope = (right - left) * cells_per_x;
  const double centre = middle + (0.5 * (left + right) - middle) * (1.0 / 3.0);
  return {static_cast<float>(centre - slope * middle_x), static_cast<float>(slope)};
}

// (e^(lambda log) - 1) / lambda, log itself at lambda = 0.
double power_less_one(double log, double lambda) {
  return std::abs(lambda) < kTukeyLambdaSeries ? log : std::expm1(lambda * log) / lambda;
}

// A point j of an octave lies at p = m 2^(octave - 33) with the mantissa m = 1 + j/128, so that
// p^lambda is a product of one factor per mantissa and one per octave. (1-p)^lambda is summed from
// its binomial series below p = 1/8 and needs an exponential only in the two octaves above.
class TukeyLambdaPoints {
 public:
  explicit TukeyLambdaPoints(double lambda) : lambda_(lambda) {
    for (int j = 0; j < kPointsPerOctave; ++j)
      of_mantissa_[static_cast<std::size_t>(j)] =
          power_less_one(std::log1p(static_cast<double>(j) / kPointsPerOctave), lambda);
    double term = -1.0;  // of (-p)^k / lambda
    for (std::size_t k = 0; k < series_.size(); ++k) {
      series_[k] = term;
      const auto order = static_cast<double>(k + 1);
      term *= (order - lambda) / (order + 1.0);
    }
  }

  /// Q(1 - p) at the points of an octave.
  void octave(int number, std::array<double, kPointsPerOctave>& quantile) const {
    const double of_octave = power_less_one((number - (kOctaves + 1)) * std::log(2.0), lambda_);
    const double unit = std::ldexp(1.0 / kPointsPerOctave, number - (kOctaves + 1));
    // What the first term left out adds is below 2^-40 of the series.
    const int terms = std::min(static_cast<int>(series_.size()), 40 / (kOctaves - number) + 1);
    std::array<double, kPointsPerOctave> p{}, high{};  // high: of (1-p)^lambda
    for (std::size_t j = 0; j < p.size(); ++j) p[j] = unit * static_cast<double>(p.size() + j);
    if (number >= kOctaves - 2) {
      for (std::size_t j = 0; j < p.size(); ++j)
        high[j] = power_less_one(std::log1p(-p[j]), lambda_);
    } else {  // term by term, all points at once: the compiler's vectors take them
      for (int k = terms; k-- > 0;)
        for (std::size_t j = 0; j < p.size(); ++j)
          high[j] = (high[j] + series_[static_cast<std::size_t>(k)]) * p[j];
    }
    for (std::size_t j = 0; j < p.size(); ++j)
      quantile[j] = high[j] - (of_octave + of_mantissa_[j] + lambda_ * of_octave * of_mantissa_[j]);
  }

 private:
  double lambda_;
  std::array<double, kPointsPerOctave> of_mantissa_;
  std::array<double, 14> series_;  // 2^-3 is the largest p
};

}  // namespace

std::vector<TailLine> tail_lines(const std::function<double(double p)>& upper_quantile) {
  std::vector<TailLine> lines(static_cast<std::size_t>(kTailCells));
  double left = upper_quantile(cell_start(0) * 0x1p-32);
  for (int cell = 0; cell < kTailCells - 1; ++cell) {
    const double x0 = cell_start(cell), x1 = cell_start(cell + 1);
    const double right = upper_quantile(x1 * 0x1p-32);
    const double middle = upper_quantile(0.5 * (x0 + x1) * 0x1p-32);
    lines[static_cast<std::size_t>(cell)] =
        projected(0.5 * (x0 + x1), 1.0 / (x1 - x0), left, middle, right);
    left = right;
  }
  lines.back() = {static_cast<float>(upper_quantile(0.5)), 0.0f};
  return lines;
}

void append_tukey_lambda_lines(double lambda, std::vector<TailLine>& lines) {
  const TukeyLambdaPoints points(lambda);
  std::array<double, kPointsPerOctave> at{}, next{};
  points.octave(0, at);
  for (int octave = 0; octave < kOctaves; ++octave) {
    if (octave + 1 < kOctaves)
      points.octave(octave + 1, next);
    else
      next[0] = 0.0;  // the median
    const double step = std::ldexp(0.5, octave) / kCellsPerOctave;
    for (int cell = 0; cell < kCellsPerOctave; ++cell) {
      const auto j = static_cast<std::size_t>(2 * cell);
      const double right = cell + 1 < kCellsPerOctave ? at[j + 2] : next[0];
      lines.push_back(
          projected(step * (kCellsPerOctave + cell + 0.5), 1.0 / step, at[j], at[j + 1], right));
    }
    at = next;
  }
  lines.push_back({0.0f, 0.0f});
}

const std::vector<TailLine>& normal_tail_lines() {
  static const std::vector<TailLine> lines =
      tail_lines([](double p) { return -normal_quantile(p); });
  return lines;
}

}  // namespace malus
