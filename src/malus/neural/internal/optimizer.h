// Adam (Kingma, Ba, ICLR 2015, Algorithm 1) with its whole state open, so that a checkpoint holds
// it; the learning rate's schedule; and the moving average of the weights.
#pragma once

#include "malus/neural/training_config.h"

#include <cstdint>
#include <vector>

#include <torch/torch.h>

namespace malus {

/// Rate at a step counted from 0: linear warm-up over warm_up steps, then cosine down to
/// final_rate, steps of step_factor, or constant.
double learning_rate_at(const TrainSettings& settings, std::int64_t step);

class Adam {
 public:
  /// Moments start at zero, one pair per parameter, on its device.
  Adam(std::vector<torch::Tensor> parameters, double beta1, double beta2);

  /// One update by the parameters' gradients; step counts from 0. m and v are the moments with
  /// their bias corrected, the update rate * m / (sqrt(v) + 1e-8). Parameters without a gradient
  /// stay.
  void update(double rate, std::int64_t step);

  /// First and second moments in the parameters' order; writable, for checkpoints.
  std::vector<torch::Tensor>& first_moments() { return first_; }
  std::vector<torch::Tensor>& second_moments() { return second_; }

 private:
  std::vector<torch::Tensor> parameters_, first_, second_;
  double beta1_, beta2_;
};

/// Scales all gradients together to a norm of at most `limit` (0: no limit); returns the norm
/// before. Not finite when a gradient is not.
double clip_gradients(const std::vector<torch::Tensor>& parameters, double limit);

/// average = memory * average + (1 - memory) * parameter; early on memory is (1 + step) / (10 +
/// step), so that the average forgets the first random weights.
void update_average(std::vector<torch::Tensor>& average,
                    const std::vector<torch::Tensor>& parameters, double memory, std::int64_t step);

/// The averages in the parameters' place for as long as the object lives.
class AveragedWeights {
 public:
  /// wanted: false changes nothing. `average` outlives the object; sizes as in update_average.
  AveragedWeights(std::vector<torch::Tensor> parameters, std::vector<torch::Tensor>& average,
                  bool wanted);
  ~AveragedWeights();
  AveragedWeights(const AveragedWeights&) = delete;
  AveragedWeights& operator=(const AveragedWeights&) = delete;

 private:
  void exchange();
  std::vector<torch::Tensor> parameters_;
  std::vector<torch::Tensor>& average_;
  bool wanted_;
};

}  // namespace malus
