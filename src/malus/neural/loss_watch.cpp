#include "malus/neural/internal/loss_watch.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

// Losses of healthy steps differ with their light by less than this, and few in a row.
constexpr double kExploded = 100;
constexpr int kMostExplodedSteps = 100;

std::string lower_the_rate() {
  return fmt::format(
      "lower learning_rate and train anew, into another folder or with {}; begin_with can name "
      "weights of before",
      setting("force", true));
}

}  // namespace

void LossWatch::see(double loss, double base_loss, double gradient_norm, std::int64_t step,
                    double& first_loss) {
  if (!std::isfinite(loss) || !std::isfinite(gradient_norm))
    throw InputError(source_, fmt::format("the loss is no number any more at step {}", step),
                     lower_the_rate());
  if (first_loss == 0) first_loss = loss;
  // Dark patches may come first: a loss that is like that of the input is none that exploded.
  usual_ = std::isfinite(base_loss) ? std::max(first_loss, base_loss) : first_loss;
  last_ = loss;
  exploded_steps_ = loss > kExploded * usual_ ? exploded_steps_ + 1 : 0;
  if (exploded_steps_ >= kMostExplodedSteps)
    throw InputError(source_,
                     fmt::format("the loss has exploded: {:.3g} at step {}, over {:g} times what "
                                 "it began with for {} steps",
                                 loss, step, kExploded, kMostExplodedSteps),
                     lower_the_rate());
}

std::string LossWatch::complaint() const {
  if (exploded_steps_ == 0) return "";
  return fmt::format(
      "{}: the loss has exploded, it ended at {:.3g}, {:.2g} times what it began "
      "with: the weights are of no use; {}",
      source_, last_, last_ / usual_, lower_the_rate());
}

}  // namespace malus
