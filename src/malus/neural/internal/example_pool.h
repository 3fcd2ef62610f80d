// Examples for training, made ahead by background threads and used more than once, because the
// classical guide is dear. What a step sees depends on the seed and the step alone: not on threads,
// nor on how many workers share the batch, nor on where an interrupted run went on.
//
// Every place of the whole batch has its own lane of examples: number = generation * batch + place.
// At a step the lane holds the last `pool` generations up to the newest that its refresh asks for.
// Where that is to be measured, the first steps draw from generation 0 alone while the makers go on
// as they can, and those after them get as many new examples as none of them waits for; it is
// measured again when twice as many steps were made.
#pragma once

#include "malus/base/stopwatch.h"
#include "malus/neural/internal/raw_pairs.h"
#include "malus/neural/internal/refresh.h"
#include "malus/neural/workers.h"

#include <condition_variable>
#include <deque>
#include <exception>
#include <functional>
#include <memory>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include <torch/torch.h>

namespace malus {

/// Network input and target planes: [channels, rows, cols] each; the target's size is the input's
/// or a whole multiple of it.
struct TrainingExample {
  torch::Tensor input, target;
  std::string source = {};  ///< where it comes from, for messages
};

/// A pair in the network's domain, guide and all. A picture's target is the pair's own light, else
/// the clean mosaic demosaicked. Throws InputError.
TrainingExample make_example(const RawPair& pair, const NetworkPackage& package);

struct PoolShape {
  int batch = 8;                    ///< of all workers
  int first_place = 0, places = 8;  ///< this worker's
  int pool = 32;
  Refresh refresh = {0.25};
  std::int64_t patch_rows = 32, patch_cols = 32;  ///< in planes
  int makers = 1;                                 ///< threads that make examples
};

/// Of a training by these workers. Throws InputError where they cannot share its batch evenly.
PoolShape pool_shape(const TrainingConfig& config, const Workers& workers, bool on_gpu,
                     const Refresh& refresh);

class ExamplePool {
 public:
  using Maker = std::function<TrainingExample(std::uint32_t number)>;
  /// Begins to make the examples of first_step at once. maker is called from other threads, from
  /// several at a time where shape says so.
  ExamplePool(Maker maker, const PoolShape& shape, std::uint64_t seed, std::int64_t first_step);
  ~ExamplePool();
  ExamplePool(const ExamplePool&) = delete;
  ExamplePool& operator=(const ExamplePool&) = delete;

  /// Patches of this worker's places at a step, on the device that the maker left them on, [places,
  /// channels, rows, cols]; targets as much larger as the examples' are. Waits for examples that
  /// are not there yet; throws what the maker threw. Steps must not fall.
  TrainingExample batch(std::int64_t step);
  /// Seconds since the start that batch() waited.
  double waiting_s() const { return waiting_s_; }

  /// Steps that show the makers' pace; a GPU chooses its kernels in the first of them.
  static constexpr int kMeasuringSteps = 100;
  const Refresh& refresh() const { return shape_.refresh; }
  /// Whether enough was seen for another refresh from the step on that comes next.
  bool refresh_is_due(std::int64_t step) const;
  /// New examples per place and step that the makers keep up with, a tenth of their pace left.
  /// Contract: it is due.
  double measured_refresh() const;
  /// Seconds since the last batch() that were no part of its step, as a validation's; else they
  /// would count as the step's.
  void leave_out(double seconds);
  /// Contract: refresh.from is the step that comes next.
  void set_refresh(const Refresh& refresh);

 private:
  struct Generation {
    std::vector<TrainingExample> examples;  ///< [place]
    int missing;
  };
  // What makers and steps took since the refresh was set.
  struct Pace {
    double examples = 0, making_s = 0;  ///< of all makers together
    int steps = 0;
    double waited_s = 0;    ///< at the first step that counts
    double left_out_s = 0;  ///< since that step
    Stopwatch since = {};   ///< that step
  };
  ExamplePool(Maker maker, const PoolShape& shape, std::uint64_t seed);  ///< without threads
  std::int64_t newest_wanted(std::int64_t step) const;
  void work();
  void make_next(std::unique_lock<std::mutex>& lock);
  bool complete(std::int64_t generation) const;

  Maker maker_;
  PoolShape shape_;
  std::uint64_t seed_;
  std::int64_t first_generation_ = 0;   ///< of the front
  std::int64_t wanted_ = 0;             ///< newest generation that may be made
  std::deque<Generation> generations_;  ///< from first_generation_ on
  int next_place_ = 0;                  ///< of the last generation; places: all are given out
  std::exception_ptr failure_;
  bool stop_ = false;
  double waiting_s_ = 0;
  Pace pace_;
  mutable std::mutex mutex_;
  std::condition_variable changed_;
  std::vector<std::thread> threads_;
};

/// What the configuration says, or what the run has known so far; else it is measured from `step`
/// on.
Refresh first_refresh(const TrainingConfig& config, const Refresh& known, std::int64_t step);

/// As the pools of all workers measured it, their mean, for they share the batch; from `step` on,
/// which comes next. All call it when it is due.
Refresh settled_refresh(ExamplePool& pool, std::int64_t step, Workers& workers,
                        const torch::Device& device);

}  // namespace malus
