// The pieces of one BM3D pass as the driver sees them: padded planes, block matching of a tile of
// reference blocks, the transform of the tile's columns, collaborative filtering of the groups.
#pragma once

#include "malus/denoise/internal/bm3d_parameters.h"
#include "malus/denoise/internal/bm3d_transform.h"
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

/// One tile of reference blocks: refs start at (row, col) of the picture.
struct Tile {
  int row, col;
  int ref_rows, ref_cols;  ///< at most tile_rows and tile_columns
};

/// The places where the blocks of a tile's groups may begin, and the columns of those blocks. What
/// is stored by place holds the rows that one row of reference blocks reaches, in a ring.
struct TileRegion {
  Tile tile;
  int step, range;  ///< of the stage
  int row, col;     ///< the first place, in the padded picture
  int rows;         ///< of places
  int cols;         ///< of pixels
  int stride;       ///< cols, rounded up to whole vectors
  int ring;         ///< rows that are stored
  std::int32_t place(int r, int c) const { return r % ring * stride + c; }
  std::size_t places() const {
    return static_cast<std::size_t>(ring) * static_cast<std::size_t>(stride);
  }
};
TileRegion region_of(const Tile& tile, const Bm3dStage& stage, const PaddedPlane& plane);

/// Rows of a region's places.
struct PlaceRows {
  int begin, end;
};
/// Those that the groups of one of the tile's rows of reference blocks reach.
PlaceRows rows_reached(const TileRegion& region, int ref_row);

/// The places of a group's blocks, best first, as numbered by the tile's region; the first is the
/// reference block itself.
struct BlockGroup {
  std::int32_t count;  ///< a power of two
  std::array<std::int32_t, kMaxGroup> place;
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
  std::vector<std::int16_t> values;  ///< from `offset` on [plane][row][column modulo step][cell]
  std::size_t offset;                ///< such that the tile's first cells lie at whole vectors
  std::ptrdiff_t plane_stride, row_stride, phase_stride;
  int first_cell;  ///< cells left of the tile's first
  int cell_rows;   ///< rows of cells that the tile's blocks cover
  bool clamp;      ///< differences may exceed 255
  const std::int16_t* first() const { return values.data() + offset; }
};

MatchSteps quantise(const MatchInput& input, const Bm3dStage& stage, const Tile& tile);

/// Finds the groups of a tile with its region. Candidates lie where reference blocks may lie, so
/// never in the padding but for what the lattice needs. For every reference the stage.group nearest
/// candidates whose distance is below kMatchFullScale, cut down to a power of two. groups: ref_rows
/// * ref_cols, row by row.
void match_tile(const MatchInput& input, const Bm3dStage& stage,
                std::span<const Displacement> order, const Tile& tile, const TileRegion& region,
                std::span<BlockGroup> groups);

/// What overlapping blocks share. spectra: [place][kPatch], for every place of these rows the eight
/// pixels from there downwards, transformed (unscaled). So a block is eight neighbouring places, 64
/// floats in a row, with half of its 2-D transform done.
void transform_columns(BlockTransform transform, const PaddedPlane& plane, const TileRegion& region,
                       PlaceRows rows, float* spectra);

/// The way back, which is linear too, so that blocks are summed before it: adds to plane, for every
/// place, the inverse transform of its eight coefficients times the window. Leaves zeros in
/// spectra.
void move_columns(BlockTransform transform, const TileRegion& region, PlaceRows rows,
                  float* spectra, Image& plane);

/// Adds one number per place to plane and leaves zeros.
void move_places(const TileRegion& region, PlaceRows rows, float* values, Image& plane);

/// Where the groups of one channel are read from and added to, by place of the tile's region.
struct FilterTarget {
  const float* noisy;   ///< spectra of the columns
  const float* pilot;   ///< likewise; null in the first pass
  float* residual;      ///< += weight * window along the row * (estimate - noisy), likewise
  float* weight;        ///< += weight, at the block's place
  float* passed_noise;  ///< += weight * share of the noise that passed, there; may be null
};

/// Shrinkage constants of one channel, for every group size; built once per pass.
class GroupFilter {
 public:
  /// First pass: keep coefficients above threshold * sigma.
  static GroupFilter hard(float sigma, float threshold);
  /// Second pass: empirical Wiener gains from the pilot.
  static GroupFilter wiener(float sigma);
  BlockTransform transform() const {
    return wiener_ ? BlockTransform::dct : BlockTransform::biorthogonal;
  }
  void run(std::span<const BlockGroup> groups, const FilterTarget& target) const;

  static constexpr int kLanes = 16;
  /// In the layout of the kernels: [coefficient along the row][lane], the coefficients down the
  /// columns of two blocks side by side.
  using Table = std::array<std::array<float, kLanes>, kPatch>;
  struct Tables {
    alignas(64) Table power;           ///< hard: smallest power kept; Wiener: 1 / noise power
    alignas(64) Table mean;            ///< 1 at the group's mean, which is never shrunk
    std::array<float, kPatch> taken;   ///< back along the row; negative: what is filtered away
    std::array<float, kPatch> window;  ///< along the row
  };

 private:
  GroupFilter() = default;
  bool wiener_ = false;
  Tables tables_;
};

}  // namespace malus::internal
