#include "malus/polar/layout_check.h"

#include "malus/base/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kBlockRowsPerTask = 32;

struct Sums {
  double diagonal = 0, row = 0, column = 0;
  std::int64_t blocks = 0;
};

Sums block_row_sums(const float* upper, const float* lower, int blocks) {
  Sums sums;
  for (int b = 0; b < blocks; ++b) {
    const double p00 = upper[2 * b], p01 = upper[2 * b + 1];
    const double p10 = lower[2 * b], p11 = lower[2 * b + 1];
    const double s0 = 0.5 * (p00 + p01 + p10 + p11);
    if (!(s0 > 0) || !std::isfinite(s0)) continue;
    sums.diagonal += std::abs((p00 + p11) - (p01 + p10)) / s0;
    sums.row += std::abs((p00 + p01) - (p10 + p11)) / s0;
    sums.column += std::abs((p00 + p10) - (p01 + p11)) / s0;
    ++sums.blocks;
  }
  return sums;
}

Sums add(const Sums& a, const Sums& b) {
  return {a.diagonal + b.diagonal, a.row + b.row, a.column + b.column, a.blocks + b.blocks};
}

constexpr std::array<Pairing, 3> kPairings = {Pairing::kDiagonal, Pairing::kRow, Pairing::kColumn};

// Pairing of one 2x2 block of sites, or none when it is not one colour with four angles.
std::optional<Pairing> block_pairing(const SensorLayout& layout, int row, int col) {
  std::array<int, 4> position_of_angle = {-1, -1, -1, -1};
  const Color color = layout.site(layout.channel_at(row, col)).color;
  for (int p = 0; p < 4; ++p) {
    const Site& site = layout.site(layout.channel_at(row + p / 2, col + p % 2));
    if (site.color != color || !site.angle_deg) return std::nullopt;
    position_of_angle[static_cast<std::size_t>(*site.angle_deg / 45)] = p;
  }
  if (std::count(position_of_angle.begin(), position_of_angle.end(), -1) > 0) return std::nullopt;
  switch (position_of_angle[0] ^ position_of_angle[2]) {  // bit 0: column, bit 1: row
    case 1:
      return Pairing::kRow;
    case 2:
      return Pairing::kColumn;
    default:
      return Pairing::kDiagonal;
  }
}

}  // namespace

std::string_view pairing_name(Pairing pairing) {
  switch (pairing) {
    case Pairing::kDiagonal:
      return "diagonal";
    case Pairing::kRow:
      return "row";
    case Pairing::kColumn:
      return "column";
  }
  return "";
}

double LayoutCheck::score(Pairing pairing) const {
  switch (pairing) {
    case Pairing::kDiagonal:
      return diagonal;
    case Pairing::kRow:
      return row;
    case Pairing::kColumn:
      return column;
  }
  return 0;
}

Pairing LayoutCheck::winner() const {
  return *std::min_element(kPairings.begin(), kPairings.end(),
                           [&](Pairing a, Pairing b) { return score(a) < score(b); });
}

double LayoutCheck::margin() const {
  std::array<double, 3> scores = {diagonal, row, column};
  std::sort(scores.begin(), scores.end());
  if (scores[1] == 0) return 1;
  return scores[0] > 0 ? scores[1] / scores[0] : std::numeric_limits<double>::infinity();
}

bool LayoutCheck::decided() const {
  return blocks >= kDecisiveBlocks && margin() >= kDecisiveMargin;
}

LayoutCheck check_layout(View<const float> mosaic) {
  const int block_rows = mosaic.rows() / 2, block_cols = mosaic.cols() / 2;
  const Sums sums = parallel_reduce(
      0, block_rows, kBlockRowsPerTask, Sums{},
      [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        Sums part;
        for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
          part = add(part, block_row_sums(mosaic.row(2 * r), mosaic.row(2 * r + 1), block_cols));
        return part;
      },
      add);
  if (sums.blocks == 0) return {};
  const auto n = static_cast<double>(sums.blocks);
  return {sums.diagonal / n, sums.row / n, sums.column / n, sums.blocks};
}

std::optional<Pairing> declared_pairing(const SensorLayout& layout) {
  if (layout.rows() % 2 != 0 || layout.cols() % 2 != 0) return std::nullopt;
  const auto first = block_pairing(layout, 0, 0);
  for (int r = 0; r < layout.rows(); r += 2)
    for (int c = 0; c < layout.cols(); c += 2)
      if (block_pairing(layout, r, c) != first) return std::nullopt;
  return first;
}

std::string layout_complaint(const SensorLayout& layout, const LayoutCheck& check) {
  const auto declared = declared_pairing(layout);
  if (!declared || !check.decided() || check.winner() == *declared) return {};
  return fmt::format(
      "the layout {} has its crossed polarizers on the {} pairs, the frame on the {} pairs (margin "
      "{:.2f}): is the layout right, or the frame cropped or turned?",
      layout.name(), pairing_name(*declared), pairing_name(check.winner()), check.margin());
}

}  // namespace malus
