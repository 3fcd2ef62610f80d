// Noise Flow (Abdelhamed, Brubaker, Brown, "Noise Flow: Noise Modeling with Conditional Normalizing
// Flows", ICCV 2019), the learned baseline of 001: a chain of invertible layers that carries a
// picture's noise to independent standard normals, so its likelihood is exact and sampling is the
// chain backwards. In the order from noise to normals:
//   signal-dependent layer  x / sqrt(exp(a_c + a'_c g) I + exp(b_c + b'_c g))
//   couplings               half of the planes scaled and shifted by a small network that sees the
//                           other half, the clean planes I and g; learned 1x1 mixing between
//   gain layer              x / exp(c_c + c'_c g), after the first half of the couplings
//   couplings               the other half
// The published order and counts (signal-dependent, four steps, gain, four steps); our couplings
// also see the clean planes. I and noise are in units of scale_dn, g is the natural logarithm of
// the analogue gain's factor (20 dB = ln 10).
#pragma once

#include <vector>

#include <torch/torch.h>

namespace malus {

/// One invertible step: 1x1 mixing of the planes, then an affine coupling. Contract: channels even.
class FlowStepImpl : public torch::nn::Module {
 public:
  FlowStepImpl(std::int64_t channels, std::int64_t width);
  /// x, clean: [batch, channel, row, col], gain: [batch]. log_det [batch] is added to.
  torch::Tensor forward(const torch::Tensor& x, const torch::Tensor& clean,
                        const torch::Tensor& gain, torch::Tensor& log_det);
  torch::Tensor inverse(const torch::Tensor& z, const torch::Tensor& clean,
                        const torch::Tensor& gain);
  /// Whether inverse() can take the mixing back.
  bool can_be_undone() const;

 private:
  /// Logarithm of scale (bounded) and shift for the second half of the planes.
  std::pair<torch::Tensor, torch::Tensor> coupling(const torch::Tensor& first,
                                                   const torch::Tensor& clean,
                                                   const torch::Tensor& gain);
  torch::Tensor mixing_;  ///< [channels, channels]
  torch::nn::Sequential net_{nullptr};
};
TORCH_MODULE(FlowStep);

class NoiseFlow : public torch::nn::Module {
 public:
  /// steps: couplings in all, half before and half after the gain layer; none where channels is
  /// odd.
  NoiseFlow(std::int64_t channels, std::int64_t steps, std::int64_t width);

  struct Normals {
    torch::Tensor z, log_det;  ///< [batch, channel, row, col], [batch]
  };
  Normals forward(const torch::Tensor& noise, const torch::Tensor& clean,
                  const torch::Tensor& gain);
  torch::Tensor inverse(torch::Tensor z, const torch::Tensor& clean, const torch::Tensor& gain);

  /// Whether what is drawn at a gain (g) are numbers, without light and at white: finite weights
  /// may describe mixings that cannot be undone, or deviations that float does not hold.
  bool draws_numbers(double gain);

  /// Natural logarithm of the density of each picture's noise, [batch].
  torch::Tensor log_likelihood(const torch::Tensor& noise, const torch::Tensor& clean,
                               const torch::Tensor& gain);

  /// Starts the first layer at variance = slope * I + offset at gain 0 (units of scale).
  void start_at(double slope, double offset);

  /// Logarithm of the signal-dependent layer's deviation at each clean value.
  torch::Tensor log_deviation(const torch::Tensor& clean, const torch::Tensor& gain) const;

  std::int64_t channels() const { return channels_; }
  /// How many rows and columns away inverse() looks: a coupling by two convolutions of 3 x 3.
  std::int64_t reach() const { return 2 * std::ssize(before_) + 2 * std::ssize(after_); }

 private:
  torch::Tensor log_gain(const torch::Tensor& gain) const;  ///< [batch, channel, 1, 1]

  std::int64_t channels_;
  torch::Tensor slope_, slope_gain_, offset_, offset_gain_, gain_, gain_slope_;
  std::vector<FlowStep> before_, after_;
};

}  // namespace malus
