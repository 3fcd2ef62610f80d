// The numbers of the plans, which were measured (docs/denoising-experiments.md), and how far a plan
// reaches.
#include "malus/base/error.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/internal/block_mix.h"
#include "malus/denoise/internal/detail_shrinkage.h"
#include "malus/denoise/internal/mosaic_filter.h"
#include "malus/denoise/internal/pilot_doubt.h"
#include "malus/denoise/internal/stated_error.h"

#include <algorithm>

namespace malus {
namespace {

using internal::kCell;
using internal::StackFilter;
using internal::StackStage;

// Of profile `high`, whose first pass takes a stack's axes too: it sees the linear guide only,
// which knows less of a stack than a pilot does.
constexpr float kGuideAxesPrior = 10.0f;
// Detail of this many times the noise that the last pass let through keeps half, where that pass
// combines blocks and where it is a Wiener filter's.
constexpr float kDetailOfRidge = 4.5f, kDetailOfWiener = 3.0f;

// Pixels between the references of a first Wiener pass. One whose result is but the pilot of
// combinations is as good with fewer.
constexpr int kWienerStep = 7, kPilotStep = 9;
// A fifth of a pilot pass's references, a ninth of others', tells enough of the pilot.
constexpr int kSurveyStep = 21;

int reach_of(const StackStage& stage, int period, int repeat_reach) {
  // A pixel lies in stacks whose reference is up to search + block away, and their members reach as
  // far again.
  return 2 * (std::max(stage.search_reach() * period, repeat_reach) + stage.block());
}

// Plans of one method for one layout.
class PlanMaker {
 public:
  PlanMaker(MosaicFilter filter, const SensorLayout& layout)
      : period_(std::max(layout.rows(), layout.cols())) {
    const bool periods = kCell % layout.rows() == 0 && kCell % layout.cols() == 0;
    ridge_ = filter == MosaicFilter::kRidge && periods;  // cells of one layout are alike
    // Ten periods hold too little of what repeats, short ones reach no further than a block is
    // wide.
    far_step_ = !periods ? 1 : std::max(kCell / period_, 2);
    // Combinations take the pilot at its word; the one that a Wiener pass has been over has less of
    // its noise, which tells where light is low (docs/denoising-experiments.md, "Combinations").
    last_ = ridge_ ? StackFilter::ridge : StackFilter::wiener;
    first_step_ = ridge_ ? kPilotStep : kWienerStep;
  }

  // A pilot of the hard threshold alone is none to combine by.
  MosaicFilterPlan fast() const {
    MosaicFilterPlan plan = surveyed(quick(StackFilter::wiener));
    plan.coarse = {coarse(quick(StackFilter::wiener))};
    return plan;
  }
  MosaicFilterPlan normal() const { return with_large(small_blocks(), 15, 32); }
  MosaicFilterPlan high() const {
    return with_large(
        {.hard = {hard(4, 7, 10, 32, 2.7f), hard(2, 5, 10, 32, 2.5f, kGuideAxesPrior)},
         .guided = {guided(StackFilter::wiener, 7, 10, 32), guided(last_, 3, 10, 64)},
         .detail_threshold = detail(last_),
         .coarse = {small_blocks()}},
        11, 64);
  }
  // Of the frame's own size alone, as the wide search of colour polarization is.
  MosaicFilterPlan with_repeats(MosaicFilterPlan plan) const {
    plan.repeats = far_step_ > 1;
    return plan;
  }

 private:
  StackStage hard(int side, int step, int search, int stack, float threshold,
                  float axes_prior = internal::kFrameAxes) const {
    return {.block_cells = side,
            .step = step,
            .search = search,
            .far_step = far_step_,
            .stack = stack,
            .threshold = threshold,
            .axes_prior = axes_prior};
  }
  StackStage guided(StackFilter filter, int step, int search, int stack) const {
    return {.filter = filter,
            .block_cells = 2,
            .step = step,
            .search = search,
            .far_step = far_step_,
            .stack = stack};
  }
  float detail(StackFilter filter) const {
    if (!ridge_) return 0.0f;
    return filter == StackFilter::ridge ? kDetailOfRidge : kDetailOfWiener;
  }
  MosaicFilterPlan quick(StackFilter filter, int step = kWienerStep) const {
    return {.hard = {hard(4, 15, 8, 16, 2.7f), hard(2, 11, 8, 32, 2.5f)},
            .guided = {guided(filter, step, 8, 32)},
            .detail_threshold = detail(filter),
            .coarse = {}};
  }
  // The frame of half the size, by `plan`.
  MosaicFilterPlan coarse(MosaicFilterPlan plan) const {
    // Eight periods are twice as far there, and beyond is nothing to gain.
    if (period_ == kCell) {
      for (StackStage& stage : plan.hard) stage.far_step = 1;
      for (StackStage& stage : plan.guided) stage.far_step = 1;
    }
    plan = surveyed(plan);
    if (!ridge_) return plan;
    // A quarter and an eighth of the size too: even light and slow ramps come out up to 2 dB
    // better, the rest as it was (docs/denoising-experiments.md, "Coarser scales").
    MosaicFilterPlan quarter = plan;
    quarter.coarse = {plan};
    plan.coarse = {quarter};
    return plan;
  }
  MosaicFilterPlan coarse_of_normal() const {
    MosaicFilterPlan plan = quick(last_, first_step_);
    if (ridge_) plan.guided.push_back(guided(last_, 7, 8, 64));
    return coarse(plan);
  }
  MosaicFilterPlan small_blocks() const {
    return {.hard = {hard(4, 13, 10, 32, 2.7f), hard(2, 11, 10, 32, 2.5f)},
            .guided = {guided(StackFilter::wiener, first_step_, 10, 32),
                       guided(last_, ridge_ ? 7 : 5, 10, 64)},
            .detail_threshold = detail(last_),
            .coarse = {coarse_of_normal()}};
  }
  // How far the first pilot may be believed (pilot_doubt.h), asked of stacks like the first guided
  // pass's.
  MosaicFilterPlan surveyed(MosaicFilterPlan plan) const {
    plan.survey = plan.guided.front();
    plan.survey->filter = StackFilter::wiener;
    plan.survey->step = kSurveyStep;
    return plan;
  }
  // Smooth light has few coefficients in large blocks too, and they take more noise out.
  MosaicFilterPlan with_large(MosaicFilterPlan plan, int step, int stack) const {
    plan = surveyed(plan);
    if (!ridge_) return plan;
    plan.large = guided(StackFilter::wiener, step, 10, stack);
    plan.large->block_cells = 4;
    return plan;
  }

  int period_ = 1;
  bool ridge_ = false;
  int far_step_ = 1;
  int first_step_ = kWienerStep;
  StackFilter last_ = StackFilter::wiener;
};

}  // namespace

MosaicFilterPlan mosaic_filter_plan(const std::string& method, const std::string& profile,
                                    const SensorLayout& layout) {
  const DenoiseMethod& named = denoise_method(method);
  MALUS_REQUIRE(named.on_mosaic());
  const PlanMaker plan(named.filter, layout);
  switch (denoise_profile(profile)) {
    case DenoiseProfile::kFast:
      return plan.with_repeats(plan.fast());
    case DenoiseProfile::kHigh:
      return plan.with_repeats(plan.high());
    case DenoiseProfile::kNormal:
      break;
  }
  return plan.with_repeats(plan.normal());
}

int mosaic_filter_reach(const MosaicFilterPlan& plan, const SensorLayout& layout, bool with_error,
                        int repeat_reach) {
  const int period = std::max(layout.rows(), layout.cols());
  const auto of = [&](const StackStage& stage) { return reach_of(stage, period, repeat_reach); };
  int reach = 0;
  for (const StackStage& stage : plan.hard) reach = std::max(reach, of(stage) + kCell);
  for (const StackStage& stage : plan.guided) reach += of(stage);
  if (plan.survey) reach += internal::doubt_reach(plan.survey->step);
  if (plan.large)
    reach += std::max(of(*plan.large) - of(plan.guided.front()), 0) + internal::kMixReach;
  if (with_error) reach += internal::stated_error_reach(period);
  return reach + (plan.detail_threshold > 0 ? internal::kDetailBlock : 0);
}

int mosaic_filter_border(const MosaicFilterPlan& plan, const SensorLayout& layout) {
  const int period = std::max(layout.rows(), layout.cols());
  int seen = 0;
  const auto add = [&](const StackStage& stage) {
    seen = std::max(seen, stage.search * period + 2 * stage.block());
  };
  for (const StackStage& stage : plan.hard) add(stage);
  for (const StackStage& stage : plan.guided) add(stage);
  if (plan.large) add(*plan.large);
  return (seen + internal::kMixReach + internal::kDetailBlock + 1) / 2 * 2;
}

}  // namespace malus
