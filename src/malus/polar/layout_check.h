// Which pixels of a polarization mosaic hold crossed polarizers? Malus's law gives I0 + I90 = I45 +
// I135, so the sums over the two crossed pairs of a 2x2 block agree but for noise and scene detail,
// while any other pairing differs by as much as the scene is polarized (docs/polarization.md,
// "Which pixel is which angle"). The test finds the pairing, not the handedness: [90 45; 135 0] and
// its mirror [0 45; 135 90] look alike.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

namespace malus {

/// Which pixels of a 2x2 block face each other as crossed polarizers.
enum class Pairing { kDiagonal, kRow, kColumn };

std::string_view pairing_name(Pairing pairing);  ///< "diagonal", "row", "column"

/// Scores of the three pairings: mean over 2x2 blocks of |sum of one pair - sum of the other| / S0,
/// S0 half the block's sum. The smallest belongs to the crossed polarizers.
struct LayoutCheck {
  double diagonal = 0, row = 0, column = 0;
  std::int64_t blocks = 0;  ///< blocks with S0 > 0 and finite pixels that were used

  double score(Pairing pairing) const;
  Pairing winner() const;
  /// Second-best score over the best one: 1 = a tie; infinite when the best is 0.
  double margin() const;
  /// Enough blocks, and a margin above kDecisiveMargin. An unpolarized scene decides nothing.
  bool decided() const;
};

/// Real polarization mosaics reach 1.4 and more; noise alone stays below 1.05 from a few thousand
/// blocks on.
inline constexpr double kDecisiveMargin = 1.15;
inline constexpr std::int64_t kDecisiveBlocks = 256;

/// mosaic: rows x cols, DN above black, blocks aligned at (0, 0). On 4x4 colour sensors a block is
/// one colour, so the same blocks serve. Blocks with S0 <= 0 or a pixel that is not finite are left
/// out.
LayoutCheck check_layout(View<const float> mosaic);

/// The pairing that a layout claims: where 0 and 90 of one 2x2 block lie. None for layouts whose
/// 2x2 blocks do not each hold the four angles of one colour, or do not agree.
std::optional<Pairing> declared_pairing(const SensorLayout& layout);

/// One sentence when the check decides against the declared layout; empty otherwise.
std::string layout_complaint(const SensorLayout& layout, const LayoutCheck& check);

}  // namespace malus
