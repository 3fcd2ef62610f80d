// Inner loops of the networks' forward pass on a CPU: products with packed weights and what lies
// between them. Pixels lie one after the other with their channels together (NHWC); one thread per
// call; channels in multiples of kLane where not said otherwise. Written for inference only.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

namespace malus::internal {

/// Values of one vector; columns of packed weights are filled up to a multiple of it.
inline constexpr std::ptrdiff_t kLane = 16;
constexpr std::ptrdiff_t whole_lanes(std::ptrdiff_t n) { return (n + kLane - 1) / kLane * kLane; }

/// Packed weights lie in panels of this many columns, each panel whole: 3 or 4 vectors, whichever
/// leaves no narrow panel for multiples of 48 and of 64. Float32 with shorter vectors has panels of
/// a tile's width (product-inl.h).
constexpr std::ptrdiff_t panel_of(std::ptrdiff_t cols) {
  return cols % (3 * kLane) == 0 ? 3 * kLane : 4 * kLane;
}

/// The upper half of a float32's bits.
using Bfloat16 = std::uint16_t;

/// c = a · b + bias, or c += ... . With taps, row i of a is the joint of `inner` values at each
/// a + i · a_row + tap: a convolution's window.
struct MatrixProduct {
  std::ptrdiff_t rows = 0, inner = 0, cols = 0;
  const float* a = nullptr;
  std::ptrdiff_t a_row = 0, a_inner = 1;
  std::span<const std::ptrdiff_t> taps{};  ///< empty: one, at 0
  const float* b = nullptr;                ///< packed by pack_columns, or
  std::ptrdiff_t b_inner = 0;              ///< where not 0: plain rows at this distance
  /// Where not null: in place of b, packed by pack_pairs; a (whose a_inner is 1) is then rounded to
  /// bfloat16 too, to nearest even, and the sums are float32. Needs can_round_products().
  const Bfloat16* pairs = nullptr;
  /// Where not null: in place of a, whose values are rounded already; one value more is readable
  /// behind them.
  const Bfloat16* rounded = nullptr;
  const float* bias = nullptr;  ///< cols values
  float* c = nullptr;
  std::ptrdiff_t c_row = 0;
  /// The same for several groups of rows, whose corners lie so far apart.
  std::ptrdiff_t groups = 1, a_group = 0, c_group = 0;
  bool add = false;  ///< to what c holds
  /// Where not null: one for every row, group after group; c = factor · (a · b) + bias. Not with
  /// add.
  const float* row_factors = nullptr;
  float leak = 1;  ///< at last y -> max(y, leak · y): a leaky ReLU where below 1
  /// The columns are two halves, each in multiples of kLane, packed in the order of gate_column
  /// and with its panels; c gets first half · second half. Not with add, nor with b_inner.
  bool gate = false;
  /// Where not null: ahead_row values for every row, group after group ahead_group apart, that are
  /// wanted next; they are brought nearer while the processor multiplies.
  const float* ahead = nullptr;
  std::ptrdiff_t ahead_row = 0, ahead_group = 0;
};
void multiply(const MatrixProduct& product);

/// Columns of a panel for gated products, whose first half is columns of the first half.
std::ptrdiff_t gate_panel(bool rounded);
/// Which column lies at column n of `cols` that are packed for a gate.
constexpr std::ptrdiff_t gate_column(std::ptrdiff_t n, std::ptrdiff_t cols,
                                     std::ptrdiff_t panel_cols) {
  const std::ptrdiff_t panel = n / panel_cols * panel_cols, at = n - panel,
                       half = (cols - panel < panel_cols ? cols - panel : panel_cols) / 2;
  return panel / 2 + (at < half ? at : cols / 2 + at - half);
}

/// Whether this processor multiplies bfloat16 (x86's AVX512_BF16).
bool can_round_products();
/// Whether a network's pass is faster with them: on Intel's cores with a matrix unit, and on AMD's
/// (from Zen 4), which start as many a cycle as float32's. On Intel's without one it takes 1.2 to
/// 1.6 times as long (docs/networks.md).
bool rounded_products_pay();
/// multiply() where pairs are given; in the processor's matrix unit where it has one, or as told.
void multiply_rounded(const MatrixProduct& product);
void multiply_rounded(const MatrixProduct& product, bool in_matrix_unit);
/// As such products round what they multiply: to nearest even, the smallest numbers to zero.
void round_values(const float* from, std::ptrdiff_t count, Bfloat16* to);

/// Packs b[k · inner_stride + n · col_stride], k < inner, n < cols into panels of columns; `to`
/// takes inner · whole_lanes(cols) values. panel_cols 0: those of a product without a gate.
void pack_columns(const float* b, std::ptrdiff_t inner, std::ptrdiff_t cols,
                  std::ptrdiff_t inner_stride, std::ptrdiff_t col_stride, float* to,
                  std::ptrdiff_t panel_cols = 0);
/// Packed columns (without a gate) with row k multiplied by factors[k].
void scale_packed_rows(const float* packed, std::ptrdiff_t inner, std::ptrdiff_t cols,
                       const float* factors, float* to);

/// The same for pairs: inner values of each of `taps` windows, rounded to bfloat16, two rows of
/// them interleaved; `to` takes taps · whole_pairs(inner) · whole_lanes(cols) values. inner_stride
/// counts from tap to tap too.
constexpr std::ptrdiff_t whole_pairs(std::ptrdiff_t inner) { return (inner + 1) / 2 * 2; }
void pack_pairs(const float* b, std::ptrdiff_t taps, std::ptrdiff_t inner, std::ptrdiff_t cols,
                std::ptrdiff_t inner_stride, std::ptrdiff_t col_stride, Bfloat16* to,
                std::ptrdiff_t panel_cols = 0);
/// To nearest even; not for values that are not numbers.
Bfloat16 rounded_to_bfloat16(float value);

/// y = gelu(x), by the error function (|error| < 4e-7 of it).
void gelu(float* x, std::ptrdiff_t count);
/// Rows of 2 · width values become width: first half · second half, or gelu(first) · second. y may
/// be where the halves are.
void gate_halves(const float* halves, std::ptrdiff_t rows, std::ptrdiff_t width, bool with_gelu,
                 float* y);
/// y += scale · x.
void add_scaled(float* y, const float* x, float scale, std::ptrdiff_t count);

/// Columns of x [rows, columns], whose rows lie x_row apart: sums += they or their squares; and y =
/// x · factors, rows of y y_row apart.
void add_columns(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows, std::ptrdiff_t columns,
                 bool squared, float* sums);
void scale_columns(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows,
                   std::ptrdiff_t columns, const float* factors, float* y, std::ptrdiff_t y_row);

/// Rows of x are brought to mean 0 and variance 1 (bias_free: only divided by the deviation), then
/// y = normal · weight + bias (null: none).
struct RowNorm {
  const float *weight = nullptr, *bias = nullptr;
  float epsilon = 1e-5F;
  bool bias_free = false;
  /// This many of the last channels (fewer than kLane) only fill up a vector: zeros that do not
  /// count.
  std::ptrdiff_t filling = 0;
};
void normalize_rows(const RowNorm& norm, const float* x, std::ptrdiff_t x_row, std::ptrdiff_t rows,
                    std::ptrdiff_t channels, float* y);
/// What rows are divided by, inverted: 1 / sqrt(variance + epsilon). Of y whole_lanes(rows) values
/// may be written.
void inverse_deviations(const RowNorm& norm, const float* x, std::ptrdiff_t x_row,
                        std::ptrdiff_t rows, std::ptrdiff_t channels, float* y);

/// One row of a depth-wise 3x3 convolution: rows[] are three rows of cols + 2 pixels, weight [9]
/// [channels] and bias (null: none); y has cols pixels.
void depthwise_row(const float* const rows[3], const float* weight, const float* bias,
                   std::ptrdiff_t cols, std::ptrdiff_t channels, float* y);
/// The same of 2 · width channels, whose halves are multiplied: y [cols, width]; and sums [width]
/// += the columns of y.
void depthwise_gate_row(const float* const rows[3], const float* weight, const float* bias,
                        std::ptrdiff_t cols, std::ptrdiff_t width, float* y, float* sums);

/// Winograd's F(4x4, 3x3) on one tile. Input: 6x6 pixels of x, whose rows lie x_row apart, become
/// 36 elements [channels] of v, v_element apart.
void winograd_input(const float* x, std::ptrdiff_t x_row, std::ptrdiff_t channels, float* v,
                    std::ptrdiff_t v_element);
/// Output: 36 elements [channels] of m, m_element apart, become rows x cols (at most 4x4) pixels of
/// y, whose rows lie y_row apart; with bias (null: none) and leaky ReLU as in MatrixProduct.
struct WinogradOutput {
  const float* m = nullptr;
  std::ptrdiff_t m_element = 0, channels = 0;
  const float* bias = nullptr;
  float leak = 1;
  float* y = nullptr;
  std::ptrdiff_t y_row = 0, rows = 4, cols = 4;
};
void winograd_output(const WinogradOutput& output);

/// softmax of every row of cols values of (x · scale + bias); bias null: none. blocked (null: none)
/// labels columns and rows: values whose labels differ get -100 (shifted windows, Swin).
void softmax_rows(float* x, std::ptrdiff_t rows, std::ptrdiff_t cols, float scale,
                  const float* bias, const float* labels);

}  // namespace malus::internal
