// Whether two parts of a run, on other machines or at another time, are of one configuration.
#pragma once

#include "malus/neural/workers.h"

#include <string>

#include <nlohmann/json.hpp>

namespace malus {

/// A setting that is not the same in two descriptions (config_json), by its name in the
/// configuration: "another train.batch", "other files of data.pictures", "another seed".
struct Difference {
  std::string what;       ///< empty: there is none
  std::string now, then;  ///< its values; empty where they say nothing, or too much for a line
  std::string values(const char* word = "now") const;  ///< ": 2, now 4", or nothing
};
Difference first_difference(const nlohmann::json& now, const nlohmann::json& then);

/// All workers call it with the descriptions of their own runs. Throws InputError on every one of
/// them when a description is not worker 0's; the worker whose own it is names the setting.
void require_same_run(Workers& workers, const nlohmann::json& description,
                      const torch::Device& device);

}  // namespace malus
