// Rows of an experiment whose training draws its noise from a Noise Flow: what the flow is trained
// on, and its training.
#pragma once

#include "malus/noise/model.h"

#include <filesystem>
#include <vector>

#include "experiments.h"

namespace malus::app {

/// What the flows of an experiment are trained on.
struct FlowCaptures {
  std::filesystem::path pairs;     ///< a list of captured pairs; empty: the camera takes pictures
  std::filesystem::path model;     ///< a file with the captures' layout, levels and bias
  std::vector<GainSetting> gains;  ///< that pictures are taken at
  double exposure = 1;
  int crop = 512;
};

/// Throws InputError where a row's flow could not be trained: asked before anything is trained.
void check_flow(const TableRow& row, const FlowCaptures& captures, const Common& common);

/// The weights of the row's flow, in folder. Without a list of pairs the simulated camera first
/// takes pictures of those that the row's network is trained on: at every gain as many as there are
/// lights (kFlowRatios). A finished flow is not trained again. Throws InputError, Cancelled.
std::filesystem::path trained_flow(const TableRow& row, const FlowCaptures& captures,
                                   const NoiseModel& camera, const std::filesystem::path& folder,
                                   const Common& common, Progress& progress);

/// Low-light ratios of such captures: from lights that nothing saturates in, to a tenth of it.
inline constexpr double kFlowRatios[] = {1.25, 2.5, 5, 10};

}  // namespace malus::app
