// Cutting a picture into overlapped tiles for a network: what a network needs around a tile, how
// large tiles may be, and how their results are put together.
#pragma once

#include "malus/base/progress.h"
#include "malus/neural/network.h"

#include <functional>
#include <vector>

namespace malus {

/// What an architecture demands of tiles, in pixels of its input planes.
struct TileDemand {
  /// Tiles begin at multiples of it, or the result changes; inputs are padded to multiples.
  std::int64_t multiple = 1;
  std::int64_t overlap = 0;  ///< around a tile's core
  /// Nothing beyond the overlap reaches the core, so tiled equals whole. Otherwise (windows that
  /// hand on over many blocks; statistics of the whole picture in nafnet and restormer) results
  /// are faded into each other over the overlap, or over a core where that is smaller.
  bool exact = true;
  double bytes_per_pixel = 0;  ///< peak of a forward pass in float32, measured
  /// The pass takes the kernels of docs/networks.md, which need less memory than libtorch's layers
  /// and round their products where asked to: on a CPU, if the widths are whole vectors
  /// or can be filled up to them (unet, nafnet).
  bool own_kernels = false;
};
/// on_cpu: where the pass runs.
TileDemand tile_demand(const NetworkDescription& description, bool on_cpu);

/// Part of a picture: a tile with its margins, and the weight of its results along each axis.
struct TileSpan {
  std::int64_t begin = 0, end = 0;
  std::int64_t core_begin = 0, core_end = 0;  ///< every position is in one span's core
  std::vector<float> weight;                  ///< sums to 1 over all spans at every position
};

/// Covers [0, length) by spans of equal cores that begin at multiples.
std::vector<TileSpan> tile_spans(std::int64_t length, std::int64_t core, const TileDemand& demand);

/// Rows and columns of a tile's core.
struct TileCore {
  std::int64_t rows = 0, cols = 0;
};
/// The whole picture where its bytes suffice, else the cores that cost the least work; 0 x 0 where
/// even the smallest need more.
TileCore tile_core(std::int64_t rows, std::int64_t cols, double bytes, int batch,
                   const TileDemand& demand);
/// The fewest bytes with which tile_core finds a core for a picture.
double least_tile_bytes(std::int64_t rows, std::int64_t cols, int batch, const TileDemand& demand);

/// How a picture is cut.
struct Tiling {
  std::int64_t rows = 0, cols = 0;  ///< of the whole picture
  TileCore core;
  int batch = 1;  ///< tiles that go through the network at once
  TileDemand demand;
};

struct TiledResult {
  torch::Tensor planes;  ///< [1, channels, rows * upscale, cols * upscale] of the whole picture
  int tiles = 0;         ///< how many there were
};

/// input(row span, column span) gives [1, channels, rows, cols] of a tile, network takes
/// [batch, ...] of equal tiles and gives as many results of the same size, or of `upscale` times
/// it.
TiledResult run_tiled(const Tiling& tiling,
                      const std::function<torch::Tensor(const TileSpan&, const TileSpan&)>& input,
                      const std::function<torch::Tensor(const torch::Tensor&)>& network,
                      Progress& progress);

}  // namespace malus
