#include "malus/neural/internal/recorded_pass.h"

#include "malus/base/error.h"

#include <algorithm>

#ifdef MALUS_CUDA_GRAPHS
#include <ATen/cuda/CUDAGraph.h>
#include <c10/cuda/CUDACachingAllocator.h>
#include <c10/cuda/CUDAGuard.h>
#endif

namespace malus {

// What the recorded launches read and write, at addresses that stay.
struct RecordedPass::Recording {
#ifdef MALUS_CUDA_GRAPHS
  at::cuda::CUDAGraph graph;
#endif
  TrainingExample batch;
  StepLosses losses;
  std::vector<torch::Tensor> gradients;  ///< of the parameters
};

RecordedPass::RecordedPass(std::vector<torch::Tensor> parameters, Losses losses, bool recorded)
    : parameters_(std::move(parameters)), losses_(std::move(losses)), wanted_(recorded) {}
RecordedPass::~RecordedPass() = default;

StepLosses RecordedPass::operator()(const TrainingExample& batch) {
  if (!recording_ && wanted_ && batch.input.is_cuda() && launched_ >= kLaunchedFirst) record(batch);
  return recording_ ? replayed(batch) : launched(batch);
}

StepLosses RecordedPass::launched(const TrainingExample& batch) {
  ++launched_;
  for (const torch::Tensor& parameter : parameters_)
    if (parameter.grad().defined()) parameter.mutable_grad().reset();
  const StepLosses losses = losses_(batch);
  losses.loss.backward();
  return {losses.loss.detach(), losses.base_loss.detach()};
}

#ifdef MALUS_CUDA_GRAPHS

void RecordedPass::record(const TrainingExample& batch) {
  auto made = std::make_unique<Recording>();
  made->batch = {batch.input.clone(), batch.target.clone()};
  // The recording has memory of its own: what the launched passes held is given back.
  torch::cuda::synchronize();
  c10::cuda::CUDACachingAllocator::emptyCache();
  try {
    const c10::cuda::CUDAStreamGuard apart(
        c10::cuda::getStreamFromPool(false, batch.input.device().index()));
    // Other threads send examples to the GPU meanwhile.
    made->graph.capture_begin({0, 0}, cudaStreamCaptureModeThreadLocal);
    try {
      made->losses = launched(made->batch);
    } catch (...) {
      made->graph.capture_end();
      throw;
    }
    made->graph.capture_end();
  } catch (const c10::Error& error) {
    wanted_ = false;
    refusal_ = error.what_without_backtrace();
    refusal_.resize(std::min(refusal_.size(), refusal_.find('\n')));
    return;
  }
  for (const torch::Tensor& parameter : parameters_) made->gradients.push_back(parameter.grad());
  recording_ = std::move(made);
}

StepLosses RecordedPass::replayed(const TrainingExample& batch) {
  MALUS_REQUIRE(batch.input.sizes() == recording_->batch.input.sizes() &&
                batch.target.sizes() == recording_->batch.target.sizes());
  recording_->batch.input.copy_(batch.input);
  recording_->batch.target.copy_(batch.target);
  for (std::size_t i = 0; i < parameters_.size(); ++i)
    parameters_[i].mutable_grad() = recording_->gradients[i];
  recording_->graph.replay();
  return recording_->losses;
}

#else

void RecordedPass::record(const TrainingExample&) { wanted_ = false; }
StepLosses RecordedPass::replayed(const TrainingExample& batch) { return launched(batch); }

#endif

}  // namespace malus
