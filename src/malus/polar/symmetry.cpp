#include "malus/polar/symmetry.h"

#include <algorithm>

namespace malus {
namespace {

struct Position {
  int row, col;
};

// Where the pixel that lands on (row, col) of the result comes from; rows x cols is the source's
// size.
Position source_of(Symmetry symmetry, int row, int col, int rows, int cols) {
  switch (symmetry) {
    case Symmetry::kIdentity:
      return {row, col};
    case Symmetry::kFlipLeftRight:
      return {row, cols - 1 - col};
    case Symmetry::kFlipUpDown:
      return {rows - 1 - row, col};
    case Symmetry::kRotate90:
      return {col, cols - 1 - row};
    case Symmetry::kRotate180:
      return {rows - 1 - row, cols - 1 - col};
    case Symmetry::kRotate270:
      return {rows - 1 - col, row};
    case Symmetry::kTranspose:
      return {col, row};
    case Symmetry::kAntiTranspose:
      return {rows - 1 - col, cols - 1 - row};
  }
  return {row, col};
}

Image scaled(Image image, int sign) {
  if (sign < 0)
    for (float& v : image.values()) v = -v;
  return image;
}

// The two greens of a Bayer cell are one colour to the light.
Site merged_green(Site site) {
  if (site.color == Color::kGreen2) site.color = Color::kGreen1;
  return site;
}

}  // namespace

const SymmetryFacts& facts_of(Symmetry symmetry) {
  return *std::find_if(kSymmetries.begin(), kSymmetries.end(),
                       [&](const SymmetryFacts& f) { return f.symmetry == symmetry; });
}

int angle_after(Symmetry symmetry, int angle_deg) {
  const SymmetryFacts& facts = facts_of(symmetry);
  const bool swapped = angle_deg % 90 == 0 ? facts.swap_0_90 : facts.swap_45_135;
  return swapped ? (angle_deg + 90) % 180 : angle_deg;
}

Image moved(View<const float> image, Symmetry symmetry) {
  const bool transposes = facts_of(symmetry).transposes;
  Image out(transposes ? image.cols() : image.rows(), transposes ? image.rows() : image.cols());
  for (int r = 0; r < out.rows(); ++r)
    for (int c = 0; c < out.cols(); ++c) {
      const Position from = source_of(symmetry, r, c, image.rows(), image.cols());
      out(r, c) = image(from.row, from.col);
    }
  return out;
}

AngleImages transformed(const AnglePlanes& planes, Symmetry symmetry) {
  const SymmetryFacts& facts = facts_of(symmetry);
  AngleImages out{moved(planes.i0, symmetry), moved(planes.i45, symmetry),
                  moved(planes.i90, symmetry), moved(planes.i135, symmetry)};
  if (facts.swap_0_90) std::swap(out.i0, out.i90);
  if (facts.swap_45_135) std::swap(out.i45, out.i135);
  return out;
}

StokesPlanes transformed(const StokesPlanes& stokes, Symmetry symmetry) {
  const SymmetryFacts& facts = facts_of(symmetry);
  return {moved(stokes.s0, symmetry), scaled(moved(stokes.s1, symmetry), facts.sign_s1),
          scaled(moved(stokes.s2, symmetry), facts.sign_s2)};
}

std::optional<LatticeShift> lattice_shift(const SensorLayout& layout, Symmetry symmetry) {
  const bool transposes = facts_of(symmetry).transposes;
  if (transposes && layout.rows() != layout.cols()) return std::nullopt;
  const int rows = layout.rows(), cols = layout.cols();
  const auto fits = [&](int shift_row, int shift_col) {
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        const Position from =
            source_of(symmetry, (r + shift_row) % rows, (c + shift_col) % cols, rows, cols);
        Site moved_site = layout.site(layout.channel_at(from.row, from.col));
        if (moved_site.angle_deg)
          moved_site.angle_deg = angle_after(symmetry, *moved_site.angle_deg);
        if (merged_green(moved_site) != merged_green(layout.site(layout.channel_at(r, c))))
          return false;
      }
    return true;
  };
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      if (fits(r, c)) return LatticeShift{r, c};
  return std::nullopt;
}

}  // namespace malus
