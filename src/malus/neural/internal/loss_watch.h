// Whether a training still learns: a loss that is no number or has exploded gives weights that are
// of no use.
#pragma once

#include <cstdint>
#include <string>

namespace malus {

class LossWatch {
 public:
  /// source: the configuration, for messages.
  explicit LossWatch(std::string source) : source_(std::move(source)) {}
  /// One step: its loss, that of its input (NaN where there is none) and the norm of its gradient.
  /// first_loss: of the run's first step; 0 there, then set. Throws InputError where loss or
  /// gradient is no number, or the loss has been exploded for a hundred steps.
  void see(double loss, double base_loss, double gradient_norm, std::int64_t step,
           double& first_loss);
  /// What is to be said of weights that are written now, "" where the last loss is not exploded.
  std::string complaint() const;

 private:
  std::string source_;
  double usual_ = 0, last_ = 0;
  int exploded_steps_ = 0;
};

}  // namespace malus
