#include "malus/denoise/internal/bm3d_pass.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/bm3d_stage.h"
#include "malus/denoise/internal/bm3d_transform.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace malus::internal {
namespace {

/// Everything that both passes share.
struct Work {
  std::vector<int> channels;        ///< the channels with noise
  std::vector<PaddedPlane> noisy;   ///< one per such channel
  std::vector<float> sigma;         ///< likewise
  std::vector<float> match_weight;  ///< likewise, summing to one
  Progress& progress;
};

/// Sums of one channel, padded.
struct Accumulator {
  Image residual, weight, passed_noise;
};

std::vector<Tile> tiles_of(int rows, int cols, int step) {
  const int tall = tile_rows(step), wide = tile_columns(step);
  const int ref_rows = lattice_size(rows, step), ref_cols = lattice_size(cols, step);
  std::vector<Tile> tiles;
  for (int r = 0; r < ref_rows; r += tall)
    for (int c = 0; c < ref_cols; c += wide)
      tiles.push_back(
          {r * step, c * step, std::min(tall, ref_rows - r), std::min(wide, ref_cols - c)});
  return tiles;
}

/// Tiles of one class write to places that are `classes` tiles apart and never meet, so a class
/// runs in parallel straight into the shared sums, and the order of all additions is fixed.
/// refs: reference blocks along the tile's side.
int tile_classes(const Bm3dStage& stage, int refs) {
  const int side = refs * stage.step;
  const int touched = side + 2 * stage.range + kPatch - stage.step;
  return (touched + side - 1) / side;
}

void clear(std::vector<Accumulator>& sums) {
  for (auto& sum : sums)
    for (Image* image : {&sum.residual, &sum.weight}) std::ranges::fill(image->values(), 0.0F);
}

/// What filtering a tile needs beside its groups, by place of the tile's region. Kept from tile to
/// tile, because fresh memory costs a page fault per 4096 bytes; the sums are zero between tiles.
struct TileBuffers {
  std::vector<float> noisy, pilot;                    ///< spectra of columns
  std::vector<float> residual, weight, passed_noise;  ///< sums; the first of spectra

  void reserve_for(std::size_t places) {
    for (auto* spectra : {&noisy, &pilot, &residual})
      spectra->resize(std::max(spectra->size(), places * kPatch));
    for (auto* sums : {&weight, &passed_noise}) sums->resize(std::max(sums->size(), places));
  }
};

/// Filters a tile's groups in one channel, one row of reference blocks after the other: the rows of
/// places that it reaches come in at the bottom and, when no later one reaches them, go back to the
/// picture.
void filter_channel(const PaddedPlane& noisy, const PaddedPlane* pilot, const GroupFilter& filter,
                    const TileRegion& region, std::span<const BlockGroup> groups,
                    TileBuffers& buffers, Accumulator& sum) {
  const auto transform = filter.transform();
  const bool states_error = !sum.passed_noise.empty();
  const FilterTarget target{buffers.noisy.data(), pilot ? buffers.pilot.data() : nullptr,
                            buffers.residual.data(), buffers.weight.data(),
                            states_error ? buffers.passed_noise.data() : nullptr};
  const auto move_back = [&](PlaceRows rows) {
    move_columns(transform, region, rows, target.residual, sum.residual);
    move_places(region, rows, target.weight, sum.weight);
    if (states_error) move_places(region, rows, target.passed_noise, sum.passed_noise);
  };
  PlaceRows held{};
  for (int r = 0; r < region.tile.ref_rows; ++r) {
    const PlaceRows reached = rows_reached(region, r);
    move_back({held.begin, reached.begin});
    const PlaceRows new_rows{held.end, reached.end};
    transform_columns(transform, noisy, region, new_rows, buffers.noisy.data());
    if (pilot) transform_columns(transform, *pilot, region, new_rows, buffers.pilot.data());
    held = reached;
    const auto refs = static_cast<std::size_t>(region.tile.ref_cols);
    filter.run(groups.subspan(static_cast<std::size_t>(r) * refs, refs), target);
  }
  move_back(held);
}

void filter_tile(const Work& work, const std::vector<PaddedPlane>& match_source,
                 const std::vector<PaddedPlane>* pilot, const Bm3dStage& stage,
                 const std::vector<Displacement>& order, const std::vector<GroupFilter>& filters,
                 const Tile& tile, std::vector<Accumulator>& sums) {
  std::vector<const PaddedPlane*> planes;
  std::vector<float> scale;
  for (std::size_t c = 0; c < work.channels.size(); ++c)
    if (work.match_weight[c] > 0) {
      planes.push_back(&match_source[c]);
      scale.push_back(
          static_cast<float>(match_scale(stage.match_limit, work.match_weight[c], work.sigma[c])));
    }
  const TileRegion region = region_of(tile, stage, *planes[0]);
  std::vector<BlockGroup> groups(static_cast<std::size_t>(tile.ref_rows * tile.ref_cols));
  match_tile({planes, scale}, stage, order, tile, region, groups);
  thread_local TileBuffers buffers;
  buffers.reserve_for(region.places());
  for (std::size_t c = 0; c < work.channels.size(); ++c)
    filter_channel(work.noisy[c], pilot ? &(*pilot)[c] : nullptr, filters[c], region, groups,
                   buffers, sums[c]);
}

/// One pass over the picture; contract: the sums are zero.
void run_tiles(const Work& work, const std::vector<PaddedPlane>* pilot, const Bm3dStage& stage,
               const std::vector<GroupFilter>& filters, int rows, int cols,
               std::vector<Accumulator>& sums) {
  const auto order = search_order(stage.range);
  const auto tiles = tiles_of(rows, cols, stage.step);
  const int tall = tile_rows(stage.step), wide = tile_columns(stage.step);
  const int down = tile_classes(stage, tall), across = tile_classes(stage, wide);
  for (int index = 0; index < down * across; ++index) {
    std::vector<Tile> members;
    for (const Tile& tile : tiles)
      if (tile.row / (tall * stage.step) % down * across +
              tile.col / (wide * stage.step) % across ==
          index)
        members.push_back(tile);
    parallel_for(0, std::ssize(members), 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (std::ptrdiff_t i = begin; i < end; ++i) {
        check_stop(work.progress);
        filter_tile(work, pilot ? *pilot : work.noisy, pilot, stage, order, filters,
                    members[static_cast<std::size_t>(i)], sums);
        work.progress.advance(1);
      }
    });
  }
}

/// out[c] = sum over k of w[k] * from(k)[c], the sums in registers.
template <class From>
void add_windowed(const std::array<float, kPatch>& w, From from, std::span<float> out) {
  std::array<const float*, kPatch> source;
  for (std::size_t k = 0; k < kPatch; ++k) source[k] = from(k);
  for (std::size_t c = 0; c < out.size(); ++c) {
    float sum = 0;
    for (std::size_t k = 0; k < kPatch; ++k) sum += w[k] * source[k][c];
    out[c] = sum;
  }
}

/// Spreads block weights, which are stored at the blocks' first pixels, over the blocks' pixels
/// with the window: rows [first, last) of the unpadded picture.
void spread(const Image& at_corner, int pad, int row, std::vector<float>& scratch,
            std::span<float> out) {
  static const auto window = kaiser_window();
  std::array<float, kPatch> w{};
  for (std::size_t i = 0; i < kPatch; ++i) w[i] = static_cast<float>(window[i]);
  scratch.resize(out.size() + kPatch - 1);
  add_windowed(
      w,
      [&](std::size_t k) {
        return at_corner.row(pad + row - static_cast<int>(k)) + pad - (kPatch - 1);
      },
      scratch);
  add_windowed(
      w, [&](std::size_t k) { return scratch.data() + kPatch - 1 - k; }, out);
}

/// noisy + weighted mean of the residuals. error: receives the expected squared error in units of
/// the noise's variance: the root of the share of the noise's power that passed. A law found by
/// measurement, not derived (docs/bm3d.md): where filters let little through, they also remove
/// structure, and overlapping estimates share their noise.
void finish(const PaddedPlane& noisy, const Accumulator& sum, Image& result, Image* error) {
  parallel_for(0, result.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    const auto cols = static_cast<std::size_t>(result.cols());
    std::vector<float> scratch, weight(cols), passed(cols);
    for (int r = static_cast<int>(begin); r < end; ++r) {
      spread(sum.weight, noisy.pad, r, scratch, weight);
      const float* residual = sum.residual.row(noisy.pad + r) + noisy.pad;
      const float* source = noisy.data.row(noisy.pad + r) + noisy.pad;
      for (std::size_t c = 0; c < cols; ++c) result.row(r)[c] = source[c] + residual[c] / weight[c];
      if (!error) continue;
      spread(sum.passed_noise, noisy.pad, r, scratch, passed);
      for (std::size_t c = 0; c < cols; ++c) error->row(r)[c] = std::sqrt(passed[c] / weight[c]);
    }
  });
}

Work prepare(const Planes& noisy, std::span<const float> sigma,
             std::span<const float> match_weights, int pad, Progress& progress) {
  Work work{{}, {}, {}, {}, progress};
  float total = 0;
  for (int c = 0; c < noisy.channels(); ++c) {
    const auto i = static_cast<std::size_t>(c);
    MALUS_REQUIRE(std::isfinite(sigma[i]) && sigma[i] >= 0);
    if (!(sigma[i] > 0)) continue;
    work.channels.push_back(c);
    work.noisy.push_back(padded_by_reflection(noisy[c], pad));
    work.sigma.push_back(sigma[i]);
    work.match_weight.push_back(match_weights.empty() ? 1.0F : match_weights[i]);
    total += work.match_weight.back();
  }
  MALUS_REQUIRE(work.channels.empty() || total > 0);
  for (float& weight : work.match_weight) weight /= total;
  return work;
}

}  // namespace

int lattice_size(int pixels, int step) {
  return pixels <= kPatch ? 1 : (pixels - kPatch + step - 1) / step + 1;
}

double match_scale(double match_limit, double weight_share, double sigma) {
  return std::sqrt(kMatchFullScale / (kPatchPixels * match_limit) * weight_share) / sigma;
}

PaddedPlane padded_by_reflection(const Image& plane, int pad) {
  const auto fold = [](int i, int n) {
    i = ((i % (2 * n)) + 2 * n) % (2 * n);
    return i < n ? i : 2 * n - 1 - i;
  };
  PaddedPlane padded{Image(plane.rows() + 2 * pad, plane.cols() + 2 * pad), pad};
  std::vector<int> from(static_cast<std::size_t>(padded.data.cols()));
  for (int c = 0; c < padded.data.cols(); ++c)
    from[static_cast<std::size_t>(c)] = fold(c - pad, plane.cols());
  for (int r = 0; r < padded.data.rows(); ++r) {
    const float* source = plane.row(fold(r - pad, plane.rows()));
    float* out = padded.data.row(r);
    for (std::size_t c = 0; c < from.size(); ++c) out[c] = source[from[c]];
  }
  return padded;
}

Bm3dReach bm3d_reach(const Bm3dParameters& parameters) {
  const auto reach = [](const Bm3dStage& s) { return 2 * (s.range + kPatch); };
  const auto grid = [](const Bm3dStage& s) {
    const int tall = tile_rows(s.step), wide = tile_columns(s.step);
    return s.step * std::lcm(tall * tile_classes(s, tall), wide * tile_classes(s, wide));
  };
  return {reach(parameters.hard) + reach(parameters.wiener),
          std::lcm(grid(parameters.hard), grid(parameters.wiener))};
}

Planes bm3d_with(const Bm3dParameters& parameters, const Planes& noisy,
                 std::span<const float> sigma, std::span<const float> match_weights,
                 Progress& progress, Planes* variance_out) {
  const auto channels = static_cast<std::size_t>(noisy.channels());
  MALUS_REQUIRE(sigma.size() == channels);
  MALUS_REQUIRE(match_weights.empty() || match_weights.size() == channels);
  const int rows = noisy.rows(), cols = noisy.cols();
  Planes result = noisy;
  if (variance_out) *variance_out = Planes(noisy.channels(), rows, cols);
  if (rows == 0 || cols == 0) return result;

  const Work work = prepare(noisy, sigma, match_weights, kPadding, progress);
  if (work.channels.empty()) return result;
  progress.begin("denoise", std::ssize(tiles_of(rows, cols, parameters.hard.step)) +
                                std::ssize(tiles_of(rows, cols, parameters.wiener.step)));

  std::vector<GroupFilter> filters;
  for (const float s : work.sigma)
    filters.push_back(GroupFilter::hard(s, parameters.hard_threshold));
  const auto& padded = work.noisy[0].data;
  std::vector<Accumulator> sums(work.channels.size());
  for (auto& sum : sums)
    for (Image* image : {&sum.residual, &sum.weight}) *image = Image(padded.rows(), padded.cols());
  run_tiles(work, nullptr, parameters.hard, filters, rows, cols, sums);
  std::vector<PaddedPlane> pilot;
  for (std::size_t c = 0; c < work.channels.size(); ++c) {
    Image& plane = result[work.channels[c]];
    finish(work.noisy[c], sums[c], plane, nullptr);
    pilot.push_back(padded_by_reflection(plane, kPadding));
  }

  clear(sums);
  filters.clear();
  for (const float s : work.sigma) filters.push_back(GroupFilter::wiener(s));
  if (variance_out)
    for (auto& sum : sums) sum.passed_noise = Image(padded.rows(), padded.cols());
  run_tiles(work, &pilot, parameters.wiener, filters, rows, cols, sums);
  for (std::size_t c = 0; c < work.channels.size(); ++c) {
    Image* error = variance_out ? &(*variance_out)[work.channels[c]] : nullptr;
    finish(work.noisy[c], sums[c], result[work.channels[c]], error);
    if (error)
      for (float& value : error->values()) value *= work.sigma[c] * work.sigma[c];
  }
  return result;
}

}  // namespace malus::internal
