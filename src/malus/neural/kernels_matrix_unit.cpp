// Weights lie as pack_pairs puts them, which is what the unit wants. Of its registers 0 to 3 hold
// sums: two tiles of rows by two of columns.
#include "malus/base/error.h"
#include "malus/neural/internal/matrix_unit.h"

#include <algorithm>

#include <hwy/base.h>

#if HWY_ARCH_X86_64 && defined(__linux__)
#include <cpuid.h>
#include <immintrin.h>
#include <sys/syscall.h>
#include <unistd.h>

HWY_PUSH_ATTRIBUTES("avx512f,avx512bw,avx512vl,avx512dq,amx-tile,amx-bf16")
namespace malus::internal::matrix_unit {
namespace {

#include "malus/neural/internal/tile_registers-inl.h"

// Weights of a part for 32 columns, 64 KB, stay in the core's two caches.
constexpr std::ptrdiff_t kInnerBlock = 1024;
#include "malus/neural/internal/inner_parts-inl.h"

// Registers 0 to 3 for sums of this many rows (at most 16); 4 and 6 for a whole step of a and b, 5
// and 7 for a last one of this many inner values. To set them takes as long as a block of a small
// product: they stay as they are where they fit.
struct Shaped {
  std::ptrdiff_t rows = 0, last_inner = 0;
};
void shape_tiles(std::ptrdiff_t rows, std::ptrdiff_t last_inner, Shaped& shaped) {
  if (shaped.rows == rows && shaped.last_inner == last_inner) return;
  shaped = {rows, last_inner};
  TileShapes shapes;
  for (int tile = 0; tile <= 4; ++tile) shape_tile(shapes, tile, rows, 64);
  shape_tile(shapes, 6, kDepth / 2, 64);
  if (last_inner > 0) {
    shape_tile(shapes, 5, rows, whole_pairs(last_inner) * 2);
    shape_tile(shapes, 7, whole_pairs(last_inner) / 2, 64);
  }
  use_shapes(shapes);
}

// One or two tiles of columns: where their weights and biases begin, how far the second tile lies
// behind the first, and how many columns the last one has.
struct Columns {
  const Bfloat16* b;
  std::ptrdiff_t panel_width, tiles, second, last_columns;
  const float* bias;  // or null
};

// One or two tiles of rows.
struct Rows {
  const Bfloat16* a;
  std::ptrdiff_t count;
  const float* factors;  // or null
  float* c;
};

template <int kDown, int kAcross>
HWY_INLINE void start_at_zero() {
  clear<0>();
  if constexpr (kAcross == 2) clear<1>();
  if constexpr (kDown == 2) clear<2>();
  if constexpr (kDown == 2 && kAcross == 2) clear<3>();
}

// row_bytes 0: every row starts at the same values.
template <int kDown, int kAcross>
HWY_INLINE void start_at(const float* from, std::ptrdiff_t row_bytes) {
  const float* lower = from + kTileRows * row_bytes / kFloatBytes;
  load<0>(from, row_bytes);
  if constexpr (kAcross == 2) load<1>(from + kLane, row_bytes);
  if constexpr (kDown == 2) load<2>(lower, row_bytes);
  if constexpr (kDown == 2 && kAcross == 2) load<3>(lower + kLane, row_bytes);
}

template <int kDown, int kAcross>
HWY_INLINE void store_sums(float* to, std::ptrdiff_t row) {
  const std::ptrdiff_t bytes = row * kFloatBytes;
  store<0>(to, bytes);
  if constexpr (kAcross == 2) store<1>(to + kLane, bytes);
  if constexpr (kDown == 2) store<2>(to + kTileRows * row, bytes);
  if constexpr (kDown == 2 && kAcross == 2) store<3>(to + kTileRows * row + kLane, bytes);
}

// Adds one step of the inner dimension, by two registers of its shape: to load b's first tile a
// second time costs less than the register that would keep it.
template <int kDown, int kAcross, int kA, int kB>
HWY_INLINE void add_step(const Bfloat16* a, std::ptrdiff_t a_bytes, std::ptrdiff_t lower,
                         const Bfloat16* b, std::ptrdiff_t b_bytes, std::ptrdiff_t second) {
  load<kA>(a, a_bytes);
  load<kB>(b, b_bytes);
  multiply_add<0, kA, kB>();
  if constexpr (kAcross == 2) {
    load<kB>(b + second, b_bytes);
    multiply_add<1, kA, kB>();
  }
  if constexpr (kDown == 2) {
    load<kA>(a + lower, a_bytes);
    if constexpr (kAcross == 2) {
      multiply_add<3, kA, kB>();
      load<kB>(b, b_bytes);
    }
    multiply_add<2, kA, kB>();
  }
}

template <int kDown, int kAcross>
HWY_INLINE void add_products(const MatrixProduct& p, const InnerPart& part, const Bfloat16* corner,
                             const Columns& columns) {
  const std::ptrdiff_t a_bytes = 2 * p.a_row, lower = kTileRows * p.a_row,
                       b_bytes = 4 * columns.panel_width, second = 2 * columns.second;
  for (std::ptrdiff_t tap = part.tap0; tap < part.tap1; ++tap) {
    const Bfloat16* a = corner + (p.taps.empty() ? 0 : p.taps[static_cast<std::size_t>(tap)]);
    const Bfloat16* b = columns.b + tap * whole_pairs(p.inner) * columns.panel_width;
    std::ptrdiff_t k = part.k0;
    for (; k + kDepth <= part.k1; k += kDepth)
      add_step<kDown, kAcross, 4, 6>(a + k, a_bytes, lower, b + k * columns.panel_width, b_bytes,
                                     second);
    if (k < part.k1)
      add_step<kDown, kAcross, 5, 7>(a + k, a_bytes, lower, b + k * columns.panel_width, b_bytes,
                                     second);
  }
}

// What c gets for 16 sums of a row; before: what it holds, where that counts.
HWY_INLINE __m512 finished(const MatrixProduct& p, const InnerPart& part, const float* factor,
                           __m512 bias, __m512 sums, __m512 before) {
  if (factor == nullptr && part.first) sums = _mm512_add_ps(sums, bias);
  if (!part.first || p.add) sums = _mm512_add_ps(sums, before);
  if (!part.last) return sums;
  if (factor != nullptr) sums = _mm512_add_ps(_mm512_mul_ps(sums, _mm512_set1_ps(*factor)), bias);
  if (p.leak >= 1) return sums;
  const __m512 leaked = _mm512_mul_ps(_mm512_set1_ps(p.leak), sums);
  return sums > leaked ? sums : leaked;
}

constexpr std::ptrdiff_t kStagedRow = 2 * kLane;

// What is more than the unit's sums: from memory, row by row.
void finish_rows(const MatrixProduct& p, const InnerPart& part, const Rows& rows,
                 const Columns& columns, const float* staged) {
  const auto mask_of = [&](std::ptrdiff_t tile) {
    return static_cast<__mmask16>(
        tile + 1 == columns.tiles ? 0xFFFFU >> (kLane - columns.last_columns) : 0xFFFFU);
  };
  const auto bias_of = [&](std::ptrdiff_t tile) {
    return columns.bias == nullptr
               ? _mm512_setzero_ps()
               : _mm512_maskz_loadu_ps(mask_of(tile), columns.bias + tile * columns.second);
  };
  const __m512 bias[2] = {bias_of(0), columns.tiles == 2 ? bias_of(1) : _mm512_setzero_ps()};
  for (std::ptrdiff_t i = 0; i < rows.count; ++i) {
    const float *sums = staged + i * kStagedRow,
                *factor = rows.factors == nullptr ? nullptr : rows.factors + i;
    float* c = rows.c + i * p.c_row;
    if (p.gate) {
      const __m512 none = _mm512_setzero_ps();
      _mm512_storeu_ps(
          c,
          _mm512_mul_ps(finished(p, part, factor, bias[0], _mm512_loadu_ps(sums), none),
                        finished(p, part, factor, bias[1], _mm512_loadu_ps(sums + kLane), none)));
      continue;
    }
    for (std::ptrdiff_t tile = 0; tile < columns.tiles; ++tile) {
      const __mmask16 mask = mask_of(tile);
      const bool adds = !part.first || p.add;
      const __m512 before =
          adds ? _mm512_maskz_loadu_ps(mask, c + tile * kLane) : _mm512_setzero_ps();
      _mm512_mask_storeu_ps(
          c + tile * kLane, mask,
          finished(p, part, factor, bias[tile], _mm512_loadu_ps(sums + tile * kLane), before));
    }
  }
}

// Whether the unit's registers can start at what the sums start at and be stored as they are.
bool is_plain(const MatrixProduct& p, const InnerPart& part, const Columns& columns) {
  if (p.gate || columns.last_columns < kLane) return false;
  if (part.last && (p.leak < 1 || p.row_factors != nullptr)) return false;
  return p.bias == nullptr || !part.first || (!p.add && p.row_factors == nullptr);
}

template <int kDown, int kAcross>
HWY_INLINE void multiply_block(const MatrixProduct& p, const InnerPart& part, const Rows& rows,
                               const Columns& columns, bool plain) {
  if (plain) {
    if (!part.first || p.add)
      start_at<kDown, kAcross>(rows.c, p.c_row * kFloatBytes);
    else if (columns.bias != nullptr)
      start_at<kDown, kAcross>(columns.bias, 0);
    else
      start_at_zero<kDown, kAcross>();
    add_products<kDown, kAcross>(p, part, rows.a, columns);
    store_sums<kDown, kAcross>(rows.c, p.c_row);
    return;
  }
  alignas(64) float staged[2 * kTileRows * kStagedRow];
  start_at_zero<kDown, kAcross>();
  add_products<kDown, kAcross>(p, part, rows.a, columns);
  store_sums<kDown, kAcross>(staged, kStagedRow);
  finish_rows(p, part, rows, columns, staged);
}

// Rows [from, to) of every group in blocks of this many, which are kDown tiles.
template <int kDown>
void multiply_rows(const MatrixProduct& p, const Bfloat16* a, const InnerPart& part,
                   const Columns& columns, float* c, std::ptrdiff_t from, std::ptrdiff_t to,
                   std::ptrdiff_t block, bool fetches) {
  const bool plain = is_plain(p, part, columns);
  for (std::ptrdiff_t group = 0; group < p.groups; ++group)
    for (std::ptrdiff_t row = from; row < to; row += block) {
      const Rows rows{a + group * p.a_group + row * p.a_row, block,
                      p.row_factors == nullptr ? nullptr : p.row_factors + group * p.rows + row,
                      c + group * p.c_group + row * p.c_row};
      if (fetches) fetch(p.ahead + group * p.ahead_group + row * p.ahead_row, block * p.ahead_row);
      if (columns.tiles == 2)
        multiply_block<kDown, 2>(p, part, rows, columns, plain);
      else
        multiply_block<kDown, 1>(p, part, rows, columns, plain);
    }
}

// All rows of some columns, whose first is n.
void multiply_columns(const MatrixProduct& p, const Bfloat16* a, const InnerPart& part,
                      const Columns& columns, std::ptrdiff_t n, Shaped& shaped) {
  float* c = p.c + n;
  const bool fetches = p.ahead != nullptr && n == 0 && part.first;
  const std::ptrdiff_t last_inner = (part.k1 - part.k0) % kDepth,
                       twice = p.rows / (2 * kTileRows) * 2 * kTileRows,
                       once = p.rows / kTileRows * kTileRows, rest = p.rows - once;
  if (once > 0) shape_tiles(kTileRows, last_inner, shaped);
  multiply_rows<2>(p, a, part, columns, c, 0, twice, 2 * kTileRows, fetches);
  multiply_rows<1>(p, a, part, columns, c, twice, once, kTileRows, fetches);
  if (rest == 0) return;
  shape_tiles(rest, last_inner, shaped);
  multiply_rows<1>(p, a, part, columns, c, once, p.rows, rest, fetches);
}

// The columns of a panel that begins at column n; of a gated one a tile of either half at a time.
void multiply_panel(const MatrixProduct& p, const Bfloat16* a, const Bfloat16* b, std::ptrdiff_t n,
                    std::ptrdiff_t count, Shaped& shaped) {
  const std::ptrdiff_t width = whole_lanes(count), half = p.gate ? count / 2 : width,
                       across = p.gate ? kLane : 2 * kLane;
  for (std::ptrdiff_t col = 0; col < half; col += across) {
    const std::ptrdiff_t tiles = p.gate ? 2 : std::min(across, width - col) / kLane,
                         left = count - col - (tiles - 1) * kLane;
    const Columns columns{b + 2 * col,
                          width,
                          tiles,
                          p.gate ? half : kLane,
                          p.gate ? kLane : std::min(left, kLane),
                          p.bias == nullptr ? nullptr : p.bias + n + col};
    for_inner_parts(p, [&](const InnerPart& part) {
      multiply_columns(p, a, part, columns, p.gate ? n / 2 + col : n + col, shaped);
    });
  }
}

void multiply_panels(const MatrixProduct& p, const Bfloat16* a) {
  const std::ptrdiff_t taps = std::max<std::ptrdiff_t>(std::ssize(p.taps), 1),
                       most = p.gate ? gate_panel(true) : panel_of(p.cols);
  Shaped shaped;
  for (std::ptrdiff_t n = 0; n < p.cols; n += most)
    multiply_panel(p, a, p.pairs + n * taps * whole_pairs(p.inner), n, std::min(most, p.cols - n),
                   shaped);
  release_tiles();
}

}  // namespace
}  // namespace malus::internal::matrix_unit
HWY_POP_ATTRIBUTES

// From here on instructions that every processor has.
namespace malus::internal {
namespace {

bool ask_for_matrix_unit() {
  constexpr unsigned kBfloat16 = 1U << 22, kTiles = 1U << 24;
  unsigned a = 0, b = 0, c = 0, d = 0;
  if (__builtin_cpu_supports("avx512bf16") == 0 || __get_cpuid_count(7, 0, &a, &b, &c, &d) == 0)
    return false;
  if ((d & kBfloat16) == 0 || (d & kTiles) == 0) return false;
  constexpr long kRequestPermission = 0x1023, kTileData = 18;  // arch_prctl(2), from Linux 5.16 on
  return syscall(SYS_arch_prctl, kRequestPermission, kTileData) == 0;
}

}  // namespace

bool has_matrix_unit() {
  static const bool has = ask_for_matrix_unit();
  return has;
}

void multiply_in_matrix_unit(const MatrixProduct& p, const Bfloat16* a) {
  MALUS_REQUIRE(has_matrix_unit());
  matrix_unit::multiply_panels(p, a);
}

}  // namespace malus::internal
#else
namespace malus::internal {
bool has_matrix_unit() { return false; }
void multiply_in_matrix_unit(const MatrixProduct&, const Bfloat16*) {
  MALUS_REQUIRE(has_matrix_unit());
}
}  // namespace malus::internal
#endif
