// The pieces of one BM3D pass as the driver sees them: padded planes, block matching of a tile of
// reference blocks, collaborative filtering of the groups.
#pragma once

#include "malus/denoise/internal/bm3d_parameters.h"
#include "malus/image/view.h"

#include <array>
#include <cstdint>
#include <span>
#include <vector>

namespace malus::internal {

/// A plane continued on all sides by reflection (... 1 0 | 0 1 2 ...); data(pad, pad) is the
/// plane's first sample.
struct PaddedPlane {
  Image data;
  int pad = 0;
  std::ptrdiff_t stride() const { return data.cols(); }
};

/// Continues plane by pad rows and columns of reflection on every side.
PaddedPlane padded_by_reflection(const Image& plane, int pad);

/// Reference blocks lie at multiples of step, the first at 0, the last one at or beyond the last
/// position where a block fits.
int lattice_size(int pixels, int step);

/// Most reference blocks in a row of a tile: those whose pixels fill a vector of kCells cells.
inline int tile_columns(int step) { return step >= 3 ? 30 : step == 2 ? 28 : 24; }
/// Most rows of them: half as many keep the lists in the cache and give more tiles to share out.
inline int tile_rows(int step) { return tile_columns(step) / 2; }

/// Pixels of padding that a pass needs on each side: the last blocks may begin up to a block's side
/// beyond the last one that fits, and the spreading of weights looks one block back.
inline constexpr int kPadding = kPatch;

/// Candidate displacements within ± range, nearest first; [0] is (0, 0). The position in this list
/// breaks ties between equal distances.
struct Displacement {
  int row, col;
};
std::vector<Displacement> search_order(int range);

/// Positions of a group's blocks, best first, as offsets from the padded plane's first element; the
/// first is the reference block itself.
struct BlockGroup {
  std::int32_t count;  ///< a power of two
  std::array<std::int32_t, kMaxGroup> position;
};

/// One tile of reference blocks: refs start at (row, col) of the picture.
struct Tile {
  int row, col;
  int ref_rows, ref_cols;  ///< at most tile_rows and tile_columns
};

/// What multiplies a plane before matching: values become steps of a fraction of sigma, such that
/// match_limit noise variances per pixel reach kMatchFullScale. weight_share: the plane's part of
/// all match weights.
double match_scale(double match_limit, double weight_share, double sigma);

/// What block matching compares: value * scale, rounded, of each plane; squared differences add up.
struct MatchInput {
  std::span<const PaddedPlane* const> planes;  ///< one or more, equal padding and size
  std::span<const float> scale;                ///< one per plane
};

/// Cells (step x step pixels) along a tile's side, those that blocks only reach into included.
inline constexpr int kCells = 32;

/// A tile and its surroundings as the search reads them: integers, with the columns of each row
/// sorted by column modulo step.
struct MatchSteps {
  std::vector<std::int16_t> values;  ///< [plane][row][column modulo step][cell]
  std::ptrdiff_t plane_stride, row_stride, phase_stride;
  int first_cell;  ///< cells left of the tile's first
  int cell_rows;   ///< rows of cells that the tile's blocks cover
  bool clamp;      ///< differences may exceed 255
};

MatchSteps quantise(const MatchInput& input, const Bm3dStage& stage, const Tile& tile);

/// Finds the groups of a tile. Candidates lie where reference blocks may lie, so never in the
/// padding but for what the lattice needs. For every reference the stage.group nearest candidates
/// whose distance is below kMatchFullScale, cut down to a power of two. groups: ref_rows *
/// ref_cols, row by row.
void match_tile(const MatchInput& input, const Bm3dStage& stage,
                std::span<const Displacement> order, const Tile& tile,
                std::span<BlockGroup> groups);

/// Where groups of one channel are read from and their estimates are added to. All have the padded
/// size.
struct FilterTarget {
  const float* noisy;
  const float* pilot;   ///< null in the first pass
  float* residual;      ///< += weight * window * (estimate - noisy), per pixel
  float* weight;        ///< += weight, at the block's first pixel
  float* passed_noise;  ///< += weight * share of the noise that passed, at the block's first pixel;
                        ///< may be null
  std::ptrdiff_t stride;
};

/// Shrinkage constants of one channel, for every group size; built once per pass.
class GroupFilter {
 public:
  /// First pass: keep coefficients above threshold * sigma.
  static GroupFilter hard(float sigma, float threshold);
  /// Second pass: empirical Wiener gains from the pilot.
  static GroupFilter wiener(float sigma);
  void run(std::span<const BlockGroup> groups, const FilterTarget& target) const;

  static constexpr int kLanes = 16;
  /// In the layout of the kernels: [row of coefficients][lane], two blocks side by side.
  using Table = std::array<std::array<float, kLanes>, kPatch>;
  struct Tables {
    alignas(64) Table power;  ///< hard: smallest power kept; Wiener: 1 / noise power
    alignas(64) Table mean;   ///< 1 at the group's mean, which is never shrunk
    alignas(64) Table scale;  ///< back to pixels
  };

 private:
  GroupFilter() = default;
  bool wiener_ = false;
  Tables tables_;
  alignas(64) Table window_;
};

}  // namespace malus::internal
