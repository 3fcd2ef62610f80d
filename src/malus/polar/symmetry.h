// Flips and turns of polarization pictures: the angles turn with the picture
// (docs/polarization.md, "Turning and flipping"). All facts about the eight symmetries of the
// square lie in one table.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"
#include "malus/polar/stokes.h"

#include <array>
#include <optional>
#include <string_view>

namespace malus {

enum class Symmetry {
  kIdentity,
  kFlipLeftRight,
  kFlipUpDown,
  kRotate90,  ///< counter-clockwise
  kRotate180,
  kRotate270,
  kTranspose,      ///< rows become columns
  kAntiTranspose,  ///< mirrored at the other diagonal
};

/// What a symmetry does to polarization. A polarizer's axis θ becomes
/// sign_s2 * sign_s1 * θ + (sign_s1 < 0 ? 90 : 0), modulo 180.
struct SymmetryFacts {
  Symmetry symmetry;
  std::string_view name;
  bool transposes;   ///< height and width change places
  bool swap_0_90;    ///< the planes of 0 and 90 degrees change places
  bool swap_45_135;  ///< the planes of 45 and 135 degrees change places
  int sign_s1, sign_s2;
};

inline constexpr std::array<SymmetryFacts, 8> kSymmetries = {{
    {Symmetry::kIdentity, "identity", false, false, false, 1, 1},
    {Symmetry::kFlipLeftRight, "flip-left-right", false, false, true, 1, -1},
    {Symmetry::kFlipUpDown, "flip-up-down", false, false, true, 1, -1},
    {Symmetry::kRotate90, "rotate-90", true, true, true, -1, -1},
    {Symmetry::kRotate180, "rotate-180", false, false, false, 1, 1},
    {Symmetry::kRotate270, "rotate-270", true, true, true, -1, -1},
    {Symmetry::kTranspose, "transpose", true, true, false, -1, 1},
    {Symmetry::kAntiTranspose, "anti-transpose", true, true, false, -1, 1},
}};

const SymmetryFacts& facts_of(Symmetry symmetry);

/// Axis of a polarizer (0, 45, 90 or 135) after the symmetry.
int angle_after(Symmetry symmetry, int angle_deg);

/// Moves pixels only: rows and columns change places where the symmetry transposes.
Image moved(View<const float> image, Symmetry symmetry);

/// The four angle planes of one colour: moved, and each under the angle it now has.
AngleImages transformed(const AnglePlanes& planes, Symmetry symmetry);
/// Stokes planes: moved, with the signs of S1 and S2. The same as Stokes of the transformed planes.
StokesPlanes transformed(const StokesPlanes& stokes, Symmetry symmetry);

/// Shift (rows, columns) by which a mosaic of whole cells, moved by the symmetry, has to be read to
/// have its layout again; the two greens count as one colour. None when no shift does: then
/// transform full-resolution planes and mosaic again.
struct LatticeShift {
  int rows = 0, cols = 0;
  bool operator==(const LatticeShift&) const = default;
};
std::optional<LatticeShift> lattice_shift(const SensorLayout& layout, Symmetry symmetry);

}  // namespace malus
