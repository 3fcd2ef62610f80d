// The --noise mode of malus evaluate.
#pragma once

#include "malus/evaluate/noise_comparison.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "program.h"
#include "raw_options.h"

namespace malus::app {

struct NoiseArguments {
  std::vector<std::filesystem::path> reference, test;
  std::filesystem::path clean, model;
  std::optional<std::string> kind;  ///< of a calibrated model's noise
  int frames = 0;                   ///< drawn from the model; 0 = as many as reference frames
  NoiseComparisonSettings settings;
};

/// Compares and prints; throws InputError.
void run_noise_comparison(const NoiseArguments& arguments, const RawOptions& raw,
                          const Common& common);

}  // namespace malus::app
