// Whether two parts of a run, on other machines or at another time, are of one configuration.
#pragma once

#include "malus/neural/workers.h"

#include <string>

#include <nlohmann/json.hpp>

namespace malus {

/// The path ("train.batch") of the first value of `now` that is another in `then`, "" when none is.
std::string first_difference(const nlohmann::json& now, const nlohmann::json& then);

/// All workers call it with the descriptions of their own runs. Throws InputError on every one of
/// them when a description is not worker 0's; the worker whose own it is names the setting.
void require_same_run(Workers& workers, const nlohmann::json& description,
                      const torch::Device& device);

}  // namespace malus
