// What a run's files hold, as text that is the same on every machine and in every folder: a run
// goes on, and a finished one is taken again, only with the files that it was made from.
#pragma once

#include "malus/neural/training_config.h"

#include <filesystem>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus {

/// One hash for each kind of files that the configuration names: "models", "shards", "pairs" (with
/// the frames that the lists name), "pictures", "scenes", "validation_scenes", "begin_with". Noise
/// models are read whole. Of data, which may be many GiB, the size and the first and last 64 KiB of
/// every file count: noise drawn anew, another exposure or another crop changes them. Paths do not
/// count, so that folders can be moved. Throws InputError where a file cannot be read.
nlohmann::json contents_json(const TrainingConfig& config);

/// The hash of such files of data, and that of a noise model. Throws InputError.
std::string contents_of(const std::vector<std::filesystem::path>& files);
std::string contents_of_model(const std::filesystem::path& model);

}  // namespace malus
