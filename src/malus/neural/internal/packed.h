// Layers prepared for the kernels of a forward pass: weights packed once and again when they
// change.
#pragma once

#include "malus/neural/internal/kernels.h"

#include <optional>
#include <vector>

#include <torch/torch.h>

namespace malus::internal {

/// Whether a forward pass may take the kernels: no gradients wanted, float32, on a CPU, not under
/// autocast. Else the layers of libtorch do the same.
bool kernels_apply(const torch::Tensor& x);

/// While it lives, layers of this thread are packed for products of values rounded to bfloat16
/// (kernels.h); what the processor cannot do stays float32.
class RoundedProducts {
 public:
  explicit RoundedProducts(bool wanted);
  ~RoundedProducts();
  RoundedProducts(const RoundedProducts&) = delete;
  RoundedProducts& operator=(const RoundedProducts&) = delete;
  static bool wanted();

 private:
  bool before_;
};

/// Working memory of one task, aligned for vectors.
class Scratch {
 public:
  explicit Scratch(std::ptrdiff_t values);
  float* take(std::ptrdiff_t values);  ///< in multiples of kLane

 private:
  torch::Tensor memory_;
  std::ptrdiff_t used_ = 0;
};

/// y = W x + b of every row.
class PackedLinear {
 public:
  PackedLinear() = default;
  /// weight [outputs, inputs], or [outputs, inputs, rows, cols] of a convolution, whose taps are
  /// then packed row by row; bias [outputs] or undefined.
  /// gated: the outputs are two halves (in multiples of kLane) and what is given is first · second.
  PackedLinear(const torch::Tensor& weight, const torch::Tensor& bias, bool gated = false);
  std::ptrdiff_t inner() const { return inner_; }
  std::ptrdiff_t cols() const { return cols_; }  ///< outputs before the gate
  bool rounded() const { return packed_.scalar_type() == torch::kBFloat16; }
  /// The product without its matrices a and c.
  MatrixProduct product() const;
  void run(const float* a, std::ptrdiff_t rows, float* c, std::ptrdiff_t c_row, bool add = false,
           const float* ahead = nullptr) const;
  /// The layer of inputs that are multiplied by factors [inner]; neither gated nor rounded.
  PackedLinear with_inputs_scaled(const float* factors) const;

 private:
  std::ptrdiff_t inner_ = 0, cols_ = 0;
  bool gated_ = false;
  torch::Tensor packed_, bias_;  ///< packed_ by pack_columns or, in bfloat16, by pack_pairs
};

/// y = W norm(x) + b of every row. In float32 the norm lies in the product: its weights in W, from
/// whose rows their means are taken so that they see no mean of x, its division as a factor of the
/// sums. Where products are rounded the rows are normalised before: a mean would take the digits.
class NormedLinear {
 public:
  NormedLinear() = default;
  /// norm's pointers are read here only, inputs - filling values each.
  NormedLinear(const RowNorm& norm, const torch::Tensor& weight, const torch::Tensor& bias,
               bool gated = false);
  std::ptrdiff_t cols() const { return linear_.cols(); }
  /// Values of memory that run takes for these numbers of rows and groups.
  std::ptrdiff_t memory(std::ptrdiff_t rows, std::ptrdiff_t groups) const;
  /// p says where the rows are and where they go: rows, a, a_row, c, c_row and groups.
  void run(const MatrixProduct& p, float* memory) const;

 private:
  RowNorm norm_;
  torch::Tensor weight_, bias_;  ///< the norm's, where it is not in the product
  PackedLinear linear_;
};

/// Weight of a depth-wise 3x3 convolution [channels, 1, 3, 3] and its bias (or undefined) as
/// depthwise_row takes them.
struct PackedDepthwise {
  torch::Tensor weight, bias;
  PackedDepthwise() = default;
  PackedDepthwise(const torch::Tensor& weight, const torch::Tensor& bias);
  const float* bias_data() const { return bias.defined() ? bias.data_ptr<float>() : nullptr; }
};

/// What a module derives from its parameters, derived again when one of them or the precision of
/// products has changed.
template <class Derived>
class Cached {
 public:
  template <class Make>
  const Derived& of(const torch::nn::Module& module, Make&& make) {
    std::vector<std::pair<const void*, std::uint32_t>> state;
    bool versioned = true;
    for (const torch::Tensor& parameter : module.parameters()) {
      versioned = versioned && !parameter.is_inference();
      state.emplace_back(parameter.data_ptr(), versioned ? parameter._version() : 0);
    }
    state.emplace_back(nullptr, RoundedProducts::wanted());
    if (!derived_ || !versioned || state != state_) {
      const torch::NoGradGuard no_gradients;
      derived_.emplace(make());
      state_ = std::move(state);
    }
    return *derived_;
  }

 private:
  std::optional<Derived> derived_;
  std::vector<std::pair<const void*, std::uint32_t>> state_;
};

}  // namespace malus::internal
