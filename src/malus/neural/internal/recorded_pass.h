// Forward and backward pass of a training step. On a GPU they are a few thousand small launches,
// which take the program longer than the GPU needs for the work. Where libtorch has CUDA, the
// launches of one step are recorded (a CUDA graph) and replayed on the examples of all further
// ones.
#pragma once

#include "malus/neural/internal/example_pool.h"

#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <torch/torch.h>

namespace malus {

/// Means over a batch, without dimension.
struct StepLosses {
  torch::Tensor loss;       ///< of the network, whose gradients are taken
  torch::Tensor base_loss;  ///< of what it was given
};

class RecordedPass {
 public:
  /// Works only with tensors of the batch's device and asks for no value of them.
  using Losses = std::function<StepLosses(const TrainingExample& batch)>;

  /// The first passes are never recorded: libtorch chooses its kernels in them.
  static constexpr int kLaunchedFirst = 3;

  /// parameters: of the network, where they stay as long as the object lives (their values may
  /// change). recorded: false launches every pass.
  RecordedPass(std::vector<torch::Tensor> parameters, Losses losses, bool recorded);
  ~RecordedPass();
  RecordedPass(const RecordedPass&) = delete;
  RecordedPass& operator=(const RecordedPass&) = delete;

  /// Losses of this batch, detached, and their gradients in the parameters (none where the loss
  /// does not reach), both until the next call. Throws what `losses` throws.
  StepLosses operator()(const TrainingExample& batch);

  /// Why this GPU's passes are launched although they were to be recorded; else empty.
  const std::string& refusal() const { return refusal_; }

 private:
  struct Recording;
  StepLosses launched(const TrainingExample& batch);
  void record(const TrainingExample& batch);
  StepLosses replayed(const TrainingExample& batch);

  std::vector<torch::Tensor> parameters_;
  Losses losses_;
  bool wanted_;
  int launched_ = 0;
  std::string refusal_;
  std::unique_ptr<Recording> recording_;
};

}  // namespace malus
