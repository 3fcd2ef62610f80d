// The columns of a tile, transformed once for all blocks that share them: half of the 2-D transform
// of blocks, which overlap. Sixteen columns (or eight, where registers hold no more) are
// transformed at once, then transposed.
#include "malus/base/vector_targets.h"
#include "malus/denoise/internal/bm3d_stage.h"
#include "malus/denoise/internal/bm3d_transform.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <type_traits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "malus/denoise/bm3d_spectra.cpp"
#include <hwy/foreach_target.h>
// After foreach_target.
#include <hwy/highway.h>

#ifndef MALUS_BM3D_SPECTRA_ONCE
#define MALUS_BM3D_SPECTRA_ONCE
namespace malus::internal {

struct SpectraJob {
  TileRegion region;
  PlaceRows rows;
  std::ptrdiff_t plane_stride;       ///< of the plane, whose row 0 is the region's
  std::array<float, kPatch> back;    ///< before the inverse transform
  std::array<float, kPatch> window;  ///< down the column
};

/// Columns of a region are rounded up to a multiple of this.
inline constexpr int kSpectraColumns = 16;

}  // namespace malus::internal
#endif

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

#include "malus/denoise/internal/wide-inl.h"
// After wide-inl.h.
#include "malus/denoise/internal/bm3d_transforms-inl.h"

using Columns = std::conditional_t<kIsTwo<Floats>, Floats8, Floats>;
constexpr int kColumns = static_cast<int>(sizeof(Columns) / sizeof(float));
static_assert(kSpectraColumns % kColumns == 0);

/// The first `count` columns of a row; the others are zero.
HWY_INLINE void load_columns(const float* from, int count, Columns& out) {
  if (HWY_LIKELY(count >= kColumns)) return load(from, out);
  float some[kColumns] = {};
  std::copy_n(from, count, some);
  load(some, out);
}

/// The other way: to += the first `count` values.
HWY_INLINE void add_values(const Columns& values, int count, float* to) {
  if (HWY_LIKELY(count >= kColumns)) {
    Columns sum;
    load(to, sum);
    sum += values;
    return store(sum, to);
  }
  float some[kColumns];
  store(values, some);
  for (int c = 0; c < count; ++c) to[c] += some[c];
}

/// x[k] holds coefficients of place k and, in a vector's second half, of place 8 + k.
template <class Vector>
HWY_INLINE void store_places(const Vector (&x)[kPatch], float* spectra) {
  HWY_UNROLL(8)
  for (int k = 0; k < kPatch; ++k)
    if constexpr (sizeof(Vector) == sizeof(Floats8)) {
      store(x[k], spectra + k * kPatch);
    } else {
      store(low_half(x[k]), spectra + k * kPatch);
      store(high_half(x[k]), spectra + (kPatch + k) * kPatch);
    }
}

/// Leaves zeros behind.
template <class Vector>
HWY_INLINE void take_places(float* spectra, Vector (&x)[kPatch]) {
  HWY_UNROLL(8)
  for (int k = 0; k < kPatch; ++k)
    if constexpr (sizeof(Vector) == sizeof(Floats8))
      load(spectra + k * kPatch, x[k]);
    else
      load_row(spectra + k * kPatch, spectra + (kPatch + k) * kPatch, x[k]);
  for (int k = 0; k < kColumns * kPatch; k += kColumns) store(Columns{}, spectra + k);
}

/// Calls work(place, columns left, first pixel) for every vector of columns of the job's rows.
template <class Float, class Work>
HWY_INLINE void for_columns(const SpectraJob& job, Float* plane, Work work) {
  for (int r = job.rows.begin; r < job.rows.end; ++r)
    for (int c = 0; c < job.region.stride; c += kColumns)
      work(job.region.place(r, c), std::max(job.region.cols - c, 0),
           plane + r * job.plane_stride + c);
}

template <bool kDct>
void to_spectra(const SpectraJob& job, const float* plane, float* spectra) {
  for_columns(job, plane, [&](std::ptrdiff_t place, int count, const float* pixel) {
    Columns x[kPatch];
    HWY_UNROLL(8)
    for (int i = 0; i < kPatch; ++i) load_columns(pixel + i * job.plane_stride, count, x[i]);
    forward<kDct>(x);
    transpose(x);
    store_places(x, spectra + place * kPatch);
  });
}

template <bool kDct>
void move_spectra(const SpectraJob& job, float* spectra, float* plane) {
  for_columns(job, plane, [&](std::ptrdiff_t place, int count, float* pixel) {
    Columns x[kPatch];
    take_places(spectra + place * kPatch, x);
    transpose(x);
    HWY_UNROLL(8)
    for (int k = 0; k < kPatch; ++k) x[k] *= job.back[k];
    inverse<kDct>(x);
    HWY_UNROLL(8)
    for (int i = 0; i < kPatch; ++i)
      add_values(x[i] * job.window[i], count, pixel + i * job.plane_stride);
  });
}

void transform_dct(const SpectraJob& job, const float* plane, float* spectra) {
  to_spectra<true>(job, plane, spectra);
}
void transform_biorthogonal(const SpectraJob& job, const float* plane, float* spectra) {
  to_spectra<false>(job, plane, spectra);
}
void move_dct(const SpectraJob& job, float* spectra, float* plane) {
  move_spectra<true>(job, spectra, plane);
}
void move_biorthogonal(const SpectraJob& job, float* spectra, float* plane) {
  move_spectra<false>(job, spectra, plane);
}

void move_numbers(const SpectraJob& job, float* values, float* plane) {
  for_columns(job, plane, [&](std::ptrdiff_t place, int count, float* pixel) {
    Columns x;
    load(values + place, x);
    store(Columns{}, values + place);
    add_values(x, count, pixel);
  });
}

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace malus::internal {

HWY_EXPORT(transform_dct);
HWY_EXPORT(transform_biorthogonal);
HWY_EXPORT(move_dct);
HWY_EXPORT(move_biorthogonal);
HWY_EXPORT(move_numbers);

TileRegion region_of(const Tile& tile, const Bm3dStage& stage, const PaddedPlane& plane) {
  // Blocks begin neither before the plane nor after the lattice's last reference block.
  const auto first = [&](int ref) { return std::max(ref - stage.range, 0); };
  const auto last = [&](int ref, int refs, int padded) {
    const int lattice = lattice_size(padded - 2 * plane.pad, stage.step);
    return std::min(ref + (refs - 1) * stage.step + stage.range, (lattice - 1) * stage.step);
  };
  TileRegion region{tile, stage.step, stage.range, 0, 0, 0, 0, 0, 0};
  region.row = plane.pad + first(tile.row);
  region.col = plane.pad + first(tile.col);
  region.rows = last(tile.row, tile.ref_rows, plane.data.rows()) - first(tile.row) + 1;
  region.cols = last(tile.col, tile.ref_cols, plane.data.cols()) - first(tile.col) + kPatch;
  region.stride = (region.cols + kSpectraColumns - 1) / kSpectraColumns * kSpectraColumns;
  region.ring = 2 * stage.range + 1;
  return region;
}

PlaceRows rows_reached(const TileRegion& region, int ref_row) {
  const int row =  // of the reference block
      std::min(region.tile.row, region.range) + ref_row * region.step;
  return {std::max(row - region.range, 0), std::min(row + region.range + 1, region.rows)};
}

void transform_columns(BlockTransform transform, const PaddedPlane& plane, const TileRegion& region,
                       PlaceRows rows, float* spectra) {
  const SpectraJob job{region, rows, plane.stride(), {}, {}};
  const float* first = plane.data.row(region.row) + region.col;
  if (transform == BlockTransform::dct)
    HWY_DYNAMIC_DISPATCH(transform_dct)(job, first, spectra);
  else
    HWY_DYNAMIC_DISPATCH(transform_biorthogonal)(job, first, spectra);
}

void move_columns(BlockTransform transform, const TileRegion& region, PlaceRows rows,
                  float* spectra, Image& plane) {
  SpectraJob job{region, rows, plane.cols(), {}, {}};
  const auto back = transform_back(transform);
  static const auto window = kaiser_window();
  for (std::size_t i = 0; i < kPatch; ++i) {
    job.back[i] = static_cast<float>(back[i]);
    job.window[i] = static_cast<float>(window[i]);
  }
  float* first = plane.row(region.row) + region.col;
  if (transform == BlockTransform::dct)
    HWY_DYNAMIC_DISPATCH(move_dct)(job, spectra, first);
  else
    HWY_DYNAMIC_DISPATCH(move_biorthogonal)(job, spectra, first);
}

void move_places(const TileRegion& region, PlaceRows rows, float* values, Image& plane) {
  HWY_DYNAMIC_DISPATCH(move_numbers)
  ({region, rows, plane.cols(), {}, {}}, values, plane.row(region.row) + region.col);
}

}  // namespace malus::internal
#endif
