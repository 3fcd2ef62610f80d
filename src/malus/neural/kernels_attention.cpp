// A window's head is small: its rounded values lie in the first-level cache as tiles of the unit's
// own order, and the vectors' softmax takes most of the time. So the exponential is only as exact
// as the rounding after it asks for, weights are divided by their sum after they have met the
// values, and the unit works on the strips of rows beside the one that the vectors are at.
#include "malus/base/error.h"
#include "malus/neural/internal/matrix_unit.h"
#include "malus/neural/internal/window_attention.h"

#include <algorithm>
#include <cmath>

#include <hwy/base.h>

#if HWY_ARCH_X86_64 && defined(__linux__)
#include <immintrin.h>

#if defined(__GNUC__) && !defined(__clang__)
// GCC 12 takes the undefined operands of its own intrinsics for ours (its bug 105593).
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wuninitialized"
#pragma GCC diagnostic ignored "-Wmaybe-uninitialized"
#endif
HWY_PUSH_ATTRIBUTES("avx512f,avx512bw,avx512vl,avx512dq,avx512bf16,amx-tile,amx-bf16")
namespace malus::internal::window_attention {
namespace {

#include "malus/neural/internal/rounded_tiles-inl.h"

constexpr float kLog2OfE = 1.44269504088896341F;

// 2^f, 0 <= f < 1, by the cubic polynomial of the least relative error, 7.5e-5: rounding to
// bfloat16 loses up to 3.9e-3.
constexpr float kPowers[] = {0.9999252F, 0.6958335F, 0.2260672F, 0.07802452F};

HWY_INLINE __m512 power_of_two(__m512 t) {
  constexpr int kFromFloor = 0x09;
  const __m512 f = _mm512_reduce_ps(t, kFromFloor);
  __m512 p = _mm512_set1_ps(kPowers[3]);
  for (int i = 2; i >= 0; --i) p = _mm512_fmadd_ps(p, f, _mm512_set1_ps(kPowers[i]));
  return _mm512_scalef_ps(p, t);
}

struct Largest {
  static HWY_INLINE __m512 of(__m512 a, __m512 b) { return _mm512_max_ps(a, b); }
};
struct Sum {
  static HWY_INLINE __m512 of(__m512 a, __m512 b) { return _mm512_add_ps(a, b); }
};

template <class Fold>
HWY_INLINE __m512 fold_halves(__m512 a, __m512 b) {
  return Fold::of(_mm512_shuffle_f32x4(a, b, 0x88), _mm512_shuffle_f32x4(a, b, 0xDD));
}

// The largest values or the sums of the lanes of 16 vectors, one to a lane: every step joins two.
template <class Fold>
HWY_INLINE __m512 fold_lanes(const float* vectors) {
  __m512 two[8], four[4], eight[2];
  for (int i = 0; i < 8; ++i) {
    const __m512 a = _mm512_load_ps(vectors + 32 * i), b = _mm512_load_ps(vectors + 32 * i + 16);
    two[i] = Fold::of(_mm512_unpacklo_ps(a, b), _mm512_unpackhi_ps(a, b));
  }
  for (int i = 0; i < 4; ++i) {
    const __m512d a = _mm512_castps_pd(two[2 * i]), b = _mm512_castps_pd(two[2 * i + 1]);
    four[i] = Fold::of(_mm512_castpd_ps(_mm512_unpacklo_pd(a, b)),
                       _mm512_castpd_ps(_mm512_unpackhi_pd(a, b)));
  }
  for (int i = 0; i < 2; ++i) eight[i] = fold_halves<Fold>(four[2 * i], four[2 * i + 1]);
  return fold_halves<Fold>(eight[0], eight[1]);
}

// Sizes of a head, and of whole steps.
struct HeadSizes {
  std::ptrdiff_t pixels, whole_pixels, width, whole_width;

  explicit HeadSizes(const WindowHeads& w)
      : pixels(w.pixels),
        whole_pixels(whole_steps(w.pixels)),
        width(w.width),
        whole_width(whole_steps(w.width)) {}
};

// What pixels need: rounded queries, keys and values of a head; two strips of 16 rows each of
// scores, rounded weights and sums, and what their sums are multiplied by.
struct PixelMemory : HeadSizes {
  Bfloat16 *queries, *keys, *values, *weights;
  float *scores, *sums, *factors;

  explicit PixelMemory(const WindowHeads& w) : HeadSizes(w) {
    scores = w.memory;
    sums = scores + 2 * kTileRows * pixels;
    factors = sums + 2 * kTileRows * width;
    queries = reinterpret_cast<Bfloat16*>(factors + 2 * kTileRows);
    keys = queries + pixels * whole_width;
    values = keys + pixels * whole_width;
    weights = values + whole_pixels * width;
  }
  float* scores_of(std::ptrdiff_t strip) const { return scores + strip % 2 * kTileRows * pixels; }
  float* sums_of(std::ptrdiff_t strip) const { return sums + strip % 2 * kTileRows * width; }
  float* factors_of(std::ptrdiff_t strip) const { return factors + strip % 2 * kTileRows; }
  Bfloat16* weights_of(std::ptrdiff_t strip) const {
    return weights + strip % 2 * kTileRows * whole_pixels;
  }
};

// What softmax takes besides the scores: of the strip's rows, bias and labels.
struct Weighing {
  float scale;
  const float *bias, *labels, *row_labels;  // labels: or null
};

// Weights of a strip's rows, their largest at most 1, and the factors that bring their sums to 1.
template <bool kLabelled>
void weigh_rows(const PixelMemory& m, const Weighing& how, float* scores, Bfloat16* weights,
                float* factors) {
  constexpr float kApart = -100.0F;
  alignas(64) float folded[16 * kLane];
  alignas(64) float most[16];
  const __m512 scale = _mm512_set1_ps(how.scale), log2_of_e = _mm512_set1_ps(kLog2OfE);
  for (std::ptrdiff_t r = 0; r < kTileRows; ++r) {
    float* row = scores + r * m.pixels;
    __m512 largest = _mm512_set1_ps(-3.0e38F);
    for (std::ptrdiff_t c = 0; c < m.pixels; c += kLane) {
      __m512 value = _mm512_fmadd_ps(_mm512_load_ps(row + c), scale,
                                     _mm512_loadu_ps(how.bias + r * m.pixels + c));
      if constexpr (kLabelled) {
        const __mmask16 apart = _mm512_cmp_ps_mask(_mm512_loadu_ps(how.labels + c),
                                                   _mm512_set1_ps(how.row_labels[r]), _CMP_NEQ_UQ);
        value = _mm512_mask_add_ps(value, apart, value, _mm512_set1_ps(kApart));
      }
      _mm512_store_ps(row + c, value);
      largest = _mm512_max_ps(largest, value);
    }
    _mm512_store_ps(folded + r * kLane, largest);
  }
  _mm512_store_ps(most, _mm512_mul_ps(fold_lanes<Largest>(folded), log2_of_e));
  for (std::ptrdiff_t r = 0; r < kTileRows; ++r) {
    const float* row = scores + r * m.pixels;
    const __m512 largest = _mm512_set1_ps(most[r]);
    const auto weight = [&](std::ptrdiff_t c) {
      return power_of_two(_mm512_fmsub_ps(_mm512_load_ps(row + c), log2_of_e, largest));
    };
    __m512 sum = _mm512_setzero_ps();
    for (std::ptrdiff_t c = 0; c < m.pixels; c += kDepth) {
      const __m512 low = weight(c),
                   high = c + kLane < m.pixels ? weight(c + kLane) : _mm512_setzero_ps();
      sum = _mm512_add_ps(sum, _mm512_add_ps(low, high));
      _mm512_store_si512(weights + r * m.whole_pixels + c, rounded(low, high));
    }
    _mm512_store_ps(folded + r * kLane, sum);
  }
  _mm512_store_ps(factors, _mm512_div_ps(_mm512_set1_ps(1), fold_lanes<Sum>(folded)));
}

void scale_rows(const float* sums, std::ptrdiff_t width, const float* factors, float* to,
                std::ptrdiff_t to_row) {
  for (std::ptrdiff_t r = 0; r < kTileRows; ++r)
    for (std::ptrdiff_t c = 0; c < width; c += kLane)
      _mm512_storeu_ps(to + r * to_row + c, _mm512_mul_ps(_mm512_load_ps(sums + r * width + c),
                                                          _mm512_set1_ps(factors[r])));
}

void attend_pixels_of_head(const WindowHeads& w, const PixelMemory& m, std::ptrdiff_t head,
                           Weighing how) {
  const std::ptrdiff_t channels = w.heads * w.width, row = 3 * channels,
                       strips = w.pixels / kTileRows;
  const float *q = w.qkv + head * w.width, *k = q + channels, *v = k + channels, *bias = how.bias;
  round_rows(q, row, w.pixels, w.width, m.queries);
  round_to_columns(k, row, w.pixels, w.width, m.keys);
  round_to_inner<false>(v, row, w.pixels, w.width, m.values, nullptr);
  // Three strips at a time: the unit starts one, the vectors weigh the next, and what they weighed
  // before meets the values.
  for (std::ptrdiff_t strip = 0; strip < strips + 2; ++strip) {
    const std::ptrdiff_t weighed = strip - 1, last = strip - 2;
    if (strip < strips)
      multiply_strip(m.queries + strip * kTileRows * m.whole_width, m.whole_width, m.keys, strips,
                     m.whole_width / kDepth, m.scores_of(strip), w.pixels);
    if (last >= 0)
      multiply_strip(m.weights_of(last), m.whole_pixels, m.values, w.width / kLane,
                     m.whole_pixels / kDepth, m.sums_of(last), w.width);
    if (weighed >= 0 && weighed < strips) {
      how.bias = bias + weighed * kTileRows * w.pixels;
      how.row_labels = how.labels == nullptr ? nullptr : how.labels + weighed * kTileRows;
      const auto weigh = how.labels == nullptr ? weigh_rows<false> : weigh_rows<true>;
      weigh(m, how, m.scores_of(weighed), m.weights_of(weighed), m.factors_of(weighed));
    }
    if (last >= 0)
      scale_rows(m.sums_of(last), w.width, m.factors_of(last),
                 w.mixed + last * kTileRows * channels + head * w.width, channels);
  }
}

// What channels need, of a head: keys as the rows of a and queries as the columns of b, whose inner
// dimension is the pixels; values; scores and weights [width, width], columns of a query each.
struct ChannelMemory : HeadSizes {
  Bfloat16 *keys, *queries, *values, *weights;
  float *scores, *query_squares, *key_squares;

  explicit ChannelMemory(const WindowHeads& w) : HeadSizes(w) {
    scores = w.memory;
    query_squares = scores + width * width;
    key_squares = query_squares + width;
    keys = reinterpret_cast<Bfloat16*>(key_squares + width);
    queries = keys + width * whole_pixels;
    values = queries + whole_pixels * width;
    weights = values + pixels * whole_width;
  }
};

// 1 / length, from squares.
void invert_lengths(float* squares, std::ptrdiff_t count, float factor) {
  for (std::ptrdiff_t i = 0; i < count; i += kLane) {
    const __m512 length =
        _mm512_max_ps(_mm512_sqrt_ps(_mm512_load_ps(squares + i)), _mm512_set1_ps(1e-6F));
    _mm512_store_ps(squares + i, _mm512_div_ps(_mm512_set1_ps(factor), length));
  }
}

// The weights of 16 queries' scores, which are a tile's columns: rows of b for the values.
void weigh_columns(const ChannelMemory& m, std::ptrdiff_t tile) {
  float* scores = m.scores + tile * kLane;
  const __m512 factor = _mm512_load_ps(m.query_squares + tile * kLane);
  __m512 most = _mm512_set1_ps(-3.0e38F), sum = _mm512_setzero_ps();
  for (std::ptrdiff_t j = 0; j < m.width; ++j) {
    const __m512 value = _mm512_mul_ps(_mm512_mul_ps(_mm512_load_ps(scores + j * m.width), factor),
                                       _mm512_set1_ps(m.key_squares[j]));
    _mm512_store_ps(scores + j * m.width, value);
    most = _mm512_max_ps(most, value);
  }
  for (std::ptrdiff_t j = 0; j < m.width; ++j) {
    const __m512 value = power_of_two(_mm512_sub_ps(_mm512_load_ps(scores + j * m.width), most));
    _mm512_store_ps(scores + j * m.width, value);
    sum = _mm512_add_ps(sum, value);
  }
  const __m512 inverse = _mm512_div_ps(_mm512_set1_ps(1), sum);
  const auto weight = [&](std::ptrdiff_t j) {
    return _mm512_mul_ps(_mm512_load_ps(scores + j * m.width), inverse);
  };
  for (std::ptrdiff_t j = 0; j < m.whole_width; j += 2)
    _mm512_store_si512(
        m.weights + (j / kDepth * (m.width / kLane) + tile) * kTileValues + j % kDepth * kLane,
        j < m.width ? side_by_side(weight(j), weight(j + 1)) : _mm512_setzero_si512());
}

void attend_channels_of_head(const WindowHeads& w, const ChannelMemory& m, std::ptrdiff_t head,
                             float temperature) {
  const std::ptrdiff_t channels = w.heads * w.width, row = 3 * channels, tiles = w.width / kLane;
  const float *q = w.qkv + head * w.width, *k = q + channels, *v = k + channels;
  round_to_inner<true>(k, row, w.pixels, w.width, m.keys, m.key_squares);
  round_to_inner<false>(q, row, w.pixels, w.width, m.queries, m.query_squares);
  for (std::ptrdiff_t tile = 0; tile < tiles; ++tile)
    multiply_strip(m.keys + tile * kTileRows * m.whole_pixels, m.whole_pixels, m.queries, tiles,
                   m.whole_pixels / kDepth, m.scores + tile * kTileRows * w.width, w.width);
  round_rows(v, row, w.pixels, w.width, m.values);
  invert_lengths(m.key_squares, w.width, 1);
  invert_lengths(m.query_squares, w.width, temperature * kLog2OfE);
  for (std::ptrdiff_t tile = 0; tile < tiles; ++tile) weigh_columns(m, tile);
  for (std::ptrdiff_t i = 0; i < w.pixels; i += kTileRows)
    multiply_strip(m.values + i * m.whole_width, m.whole_width, m.weights, tiles,
                   m.whole_width / kDepth, w.mixed + i * channels + head * w.width, channels);
}

void attend_pixels(const WindowHeads& w, float scale, const float* bias, const float* labels) {
  const PixelMemory memory(w);
  shape_whole_tiles();
  for (std::ptrdiff_t head = 0; head < w.heads; ++head)
    attend_pixels_of_head(w, memory, head,
                          {scale, bias + head * w.pixels * w.pixels, labels, nullptr});
  release_tiles();
}

void attend_channels(const WindowHeads& w, const float* temperatures) {
  const ChannelMemory memory(w);
  shape_whole_tiles();
  for (std::ptrdiff_t head = 0; head < w.heads; ++head)
    attend_channels_of_head(w, memory, head, temperatures[head]);
  release_tiles();
}

}  // namespace
}  // namespace malus::internal::window_attention
HWY_POP_ATTRIBUTES
#if defined(__GNUC__) && !defined(__clang__)
#pragma GCC diagnostic pop
#endif

namespace malus::internal {

void attend_pixels_in_unit(const WindowHeads& window, float scale, const float* bias,
                           const float* labels) {
  MALUS_REQUIRE(has_matrix_unit());
  window_attention::attend_pixels(window, scale, bias, labels);
}

void attend_channels_in_unit(const WindowHeads& window, const float* temperatures) {
  MALUS_REQUIRE(has_matrix_unit());
  window_attention::attend_channels(window, temperatures);
}

}  // namespace malus::internal
#else
namespace malus::internal {
void attend_pixels_in_unit(const WindowHeads&, float, const float*, const float*) {
  MALUS_REQUIRE(has_matrix_unit());
}
void attend_channels_in_unit(const WindowHeads&, const float*) { MALUS_REQUIRE(has_matrix_unit()); }
}  // namespace malus::internal
#endif

namespace malus::internal {

// As PixelMemory and ChannelMemory take it, two rounded values to a float32.
std::ptrdiff_t attention_memory(std::ptrdiff_t pixels, std::ptrdiff_t width) {
  constexpr std::ptrdiff_t kStep = 32;
  const auto whole = [](std::ptrdiff_t n) { return (n + kStep - 1) / kStep * kStep; };
  const std::ptrdiff_t n = whole(pixels), w = whole(width);
  return std::max(32 * (pixels + width + 1) + (2 * pixels * w + n * width + 32 * n) / 2,
                  width * (width + 2) + (2 * width * n + pixels * w + w * width) / 2);
}

}  // namespace malus::internal
