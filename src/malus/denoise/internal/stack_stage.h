// One pass of the mosaic filter over a tile: for every reference block a stack of similar blocks is
// gathered, transformed, shrunk and put back. Blocks are cut into cells of 4x4 mosaic pixels, and a
// cell is one vector of 16 floats: whatever the sensor's layout, the position inside the cell takes
// the part of a colour or polarization channel.
#pragma once

#include "malus/base/progress.h"
#include "malus/image/view.h"

#include <array>
#include <limits>
#include <vector>

namespace malus::internal {

/// a / b rounded down; contract: b > 0.
constexpr int floor_div(int a, int b) { return a >= 0 ? a / b : -((b - 1 - a) / b); }

inline constexpr int kCell = 4;               ///< mosaic pixels per side of a cell
inline constexpr int kLanes = kCell * kCell;  ///< values of a cell, row by row
inline constexpr int kMaxBlockCells = 4;      ///< cells per side of the largest block
inline constexpr int kMaxStack = 64;

using CellVector = std::array<float, kLanes>;
/// rotation[i][k]: weight of value i in component k; columns are orthonormal.
using CellMatrix = std::array<CellVector, kLanes>;

/// What a stack's blocks are estimated by.
enum class StackFilter {
  hard,    ///< a threshold for the coefficients of the transformed stack
  wiener,  ///< gains of these coefficients, from the pilot's
  ridge,   ///< linear combinations of the blocks, by the pilot's products; blocks of 2 cells alone
};

struct StackStage {
  StackFilter filter = StackFilter::hard;
  int block_cells = 4;  ///< cells per side of a block: 2 or 4
  int step = 4;         ///< mosaic pixels between reference blocks; not a multiple of the cell, so
                        ///< that all alignments of cells and mosaic are averaged
  int search = 13;      ///< blocks are compared up to this many layout cells away,
  int far_step = 1;     ///< and in the frame every far_step-th, far_step times as far, if above 1
  int stack = 32;       ///< blocks per stack, a power of two
  float threshold = 2.7f;  ///< of the hard filter, in deviations of the noise
  /// Components are the principal axes of the guide in the stack itself plus the frame's axes with
  /// this weight (StageInput::axes_prior); kFrameAxes: those of the frame alone.
  float axes_prior = 1.0f;
  int block() const { return block_cells * kCell; }
  int search_reach() const { return search * far_step; }  ///< layout cells
};
inline constexpr float kFrameAxes = std::numeric_limits<float>::infinity();

/// A rectangle of the frame with its surroundings; (row0, col0) is the frame's position of (0, 0)
/// and may be negative in the extension beyond the border.
struct StackTile {
  Image pixels;
  int row0 = 0, col0 = 0;
};

/// One value for every reference of a pass.
struct ReferenceMap {
  int step = 1;                      ///< mosaic pixels between references
  int first_row = 0, first_col = 0;  ///< the frame's position of values(0, 0), in steps
  Image values;                      ///< 0 where there is no reference
};

class Repeats;

struct StageInput {
  const StackTile* noisy;  ///< unit noise
  const Image* guide;  ///< same size: where blocks are compared; after the hard filter the pilot
  int period_rows, period_cols;  ///< of the layout: blocks are moved by whole periods
  int frame_rows, frame_cols;    ///< references must touch the frame itself
  /// Principal axes of the frame per alignment, [row % period_rows * period_cols + col %
  /// period_cols], and the matrices that pull a stack's axes towards them.
  const std::vector<CellMatrix>* rotations = nullptr;
  const std::vector<CellMatrix>* axes_prior = nullptr;
  const Repeats* repeats = nullptr;  ///< of the frame, for stages with a wide search
  /// How far the pilot is doubted (pilot_doubt.h), of guided passes; null: 1 everywhere.
  const ReferenceMap* doubt = nullptr;
};

/// Of the weak coefficients in the stacks' strongest components: what the samples hold beyond their
/// noise, and what the pilot holds [sums of noise variances] (pilot_doubt.h).
struct PilotEvidence {
  ReferenceMap excess, energy;
};

/// One value for every cell of the frame's lattice that a tile touches.
struct CellMap {
  int first_row = 0, first_col = 0;  ///< the frame's cell of values(0, 0)
  Image values;

  explicit CellMap(const StackTile& tile)
      : first_row(floor_div(tile.row0, kCell)),
        first_col(floor_div(tile.col0, kCell)),
        values(floor_div(tile.row0 + tile.pixels.rows() - 1, kCell) - first_row + 1,
               floor_div(tile.col0 + tile.pixels.cols() - 1, kCell) - first_col + 1) {}
};

/// How unlike blocks without a copy are, and what is said where nothing is known.
inline constexpr float kUnlikeAny = 1e6f;

/// What a pass tells besides its estimate, [noise variances] per pixel; of what is null nothing.
struct StageReport {
  Image* stein = nullptr;  ///< Stein's estimate of the squared error, not of combinations; else:
  Image* noise = nullptr;  ///< noise that the weights let through
  /// Of the samples' noise, the part that the stacks let through.
  ReferenceMap* passed = nullptr;
  /// What became of StageInput::doubt in every stack's strongest components, of Wiener filters
  /// alone.
  ReferenceMap* settled = nullptr;
  PilotEvidence* evidence = nullptr;  ///< of Wiener filters alone
  /// How unlike the blocks of the stacks there are: variance of their samples about their mean,
  /// less that of noise. Of copies slightly below 0, for blocks are chosen that look alike.
  CellMap* unlike = nullptr;
};

/// Estimate of the tile's pixels. Those that no stack reached keep the noisy value, with error 1.
Image run_stage(const StageInput& input, const StackStage& stage, Progress& progress,
                const StageReport& report = {});

/// Eigenvectors of a symmetric matrix, largest eigenvalue first, as the columns of the result.
CellMatrix principal_axes(const CellMatrix& symmetric, CellVector* eigenvalues = nullptr);

}  // namespace malus::internal
