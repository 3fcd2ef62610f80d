// What `malus denoise` is asked for, and the files that it will write: refused before the work
// begins where that cannot be.
#pragma once

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "denoise_files.h"
#include "denoise_method.h"
#include "program.h"
#include "raw_options.h"

namespace malus::app {

struct DenoiseArguments {
  RawOptions raw;
  DenoiseSettings settings;
  InferenceSettings inference;
  std::vector<std::filesystem::path> inputs;
  std::vector<std::filesystem::path> references;
  double reference_ratio = 1;
  std::optional<double> reference_black_dn;
  std::vector<int> origin;  ///< row, column on the sensor; empty: not told
  std::filesystem::path model, folder, report;
  std::string format = "tif";
  bool planes = false, uncertainty = false, u16 = false, extrapolate_gain = false;
  const CLI::App* command = nullptr;  ///< knows which flags were given
};

/// Refuses what there is none of where the result is a picture (target: the denoiser's), and what
/// no picture file can hold. Throws InputError.
void check_result_flags(const DenoiseArguments& arguments, NetworkTarget target);

/// Endings that --format offers.
std::vector<std::string> denoised_formats();

/// The files of every input. Throws InputError where one exists already, in this or another format,
/// unless forced.
std::vector<OutputNames> plan_denoised_files(const DenoiseArguments& arguments,
                                             NetworkTarget target, bool force);

/// A report that replaced a frame or a result would lose it: throws InputError.
void check_report(const DenoiseArguments& arguments, const std::vector<OutputNames>& names,
                  bool force);

}  // namespace malus::app
