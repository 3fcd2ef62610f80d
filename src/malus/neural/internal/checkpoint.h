// Everything that a run needs to go on as if it had not stopped, in one safetensors file that is
// written beside its name and renamed: killed at any instant, there is a whole checkpoint.
#pragma once

#include "malus/neural/internal/optimizer.h"
#include "malus/neural/internal/refresh.h"
#include "malus/neural/network.h"

#include <cstdint>
#include <filesystem>
#include <vector>

namespace malus {

/// In the metadata of a checkpoint, and of no other weight file.
inline constexpr const char* kCheckpointKey = "malus_checkpoint";

/// The moving parts of a training run. Random numbers need no state: they are functions of the seed
/// and the step.
struct TrainingState {
  Network& network;
  Adam& adam;
  std::vector<torch::Tensor>& average;  ///< in the order of the network's parameters
  std::int64_t step = 0;                ///< next one to be made
  double best_score_db = 0;             ///< image + DoLP PSNR of the best validation so far
  double seconds = 0;                   ///< of training so far, over all parts of the run
  double first_loss = 0;                ///< of the run's first step (loss_watch.h); 0 before it
  double brightest = 0;                 ///< light of the examples (trained_light.h); 0: not known
  Refresh refresh = {};                 ///< of the examples, once it is known
};

/// description: the configuration, compared when the run goes on.
void save_checkpoint(const TrainingState& state, const nlohmann::json& description,
                     const std::filesystem::path& path);

/// Fills the state; throws InputError when the file is damaged, or belongs to a run with another
/// description (the first setting that differs is named). How often there is a validation, the log
/// and checkpoints are written, how much memory examples may take and how long a silent worker is
/// waited for may differ, and so may the number of steps where the rate does not follow from it,
/// unless more were made.
void load_checkpoint(TrainingState& state, const nlohmann::json& description,
                     const std::filesystem::path& path);

}  // namespace malus
