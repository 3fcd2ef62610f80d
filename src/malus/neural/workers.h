// The processes that train one network together. Gradients are summed over them; everything else is
// a function of the step, so that nothing else needs to be told.
#pragma once

#include "malus/base/progress.h"
#include "malus/base/worker_place.h"

#include <memory>

#include <torch/torch.h>

namespace malus {

class Workers {
 public:
  virtual ~Workers() = default;
  virtual int rank() const = 0;
  virtual int size() const = 0;
  /// In place: the sum over all workers, the same bits on each. Throws InputError when a worker is
  /// lost, Cancelled as below.
  virtual void sum(torch::Tensor& values) = 0;
  /// In place: the values of worker 0.
  virtual void broadcast(torch::Tensor& values) = 0;
  /// All call it after work that worker 0 does alone: the others wait for it, however long it
  /// takes. Throws InputError when worker 0 ended; a machine that vanishes without a word is not
  /// noticed here.
  virtual void wait_for_leader() = 0;
};

/// One process alone.
std::unique_ptr<Workers> single_worker();

/// As many as the environment says (base/worker_place.h), meeting at MASTER_ADDR:MASTER_PORT
/// (127.0.0.1:29500 where not set) through PyTorch's c10d: NCCL for tensors on GPUs where libtorch
/// has it, else Gloo. A worker that is silent for timeout_s is lost, but for
/// wait_for_leader. Who waits for others tells progress, and leaves with Cancelled when it asks to
/// stop: at the meeting at once, later (but for NCCL's messages) after a few seconds, in which the
/// others may end their step and hear of it. Throws InputError.
std::unique_ptr<Workers> workers_of_environment(double timeout_s, const torch::Device& device,
                                                Progress& progress);

/// The same for a place that the caller knows; a group of one goes the same ways as any other.
std::unique_ptr<Workers> meet_workers(const WorkerPlace& place, double timeout_s,
                                      const torch::Device& device, Progress& progress);

}  // namespace malus
