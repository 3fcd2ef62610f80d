#include "denoise_plan.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"

#include <utility>

#include "denoise_checks.h"
#include "output_check.h"

namespace malus::app {
namespace {

namespace fs = std::filesystem;

// Beside the mosaic.
constexpr const char *kRecord = "_denoised.json", *kIntegers = "_denoised_u16.tif",
                     *kPlanes = "_planes.exr", *kVariance = "_variance.exr";

std::vector<fs::path> read_besides(const DenoiseArguments& arguments) {
  std::vector<fs::path> read = arguments.raw.files_read();
  read.insert(read.end(), arguments.references.begin(), arguments.references.end());
  read.push_back(arguments.model);
  return read;
}

std::vector<fs::path> files_read(const DenoiseArguments& arguments) {
  std::vector<fs::path> read = read_besides(arguments);
  read.insert(read.end(), arguments.inputs.begin(), arguments.inputs.end());
  return read;
}

}  // namespace

void check_result_flags(const DenoiseArguments& arguments, NetworkTarget target) {
  if (target != NetworkTarget::kMosaic)
    for (const auto& [given, flag] : {std::pair{arguments.planes, "--planes"},
                                      {arguments.u16, "--u16"},
                                      {arguments.uncertainty, "--uncertainty"},
                                      {!arguments.references.empty(), "--reference"},
                                      {!arguments.report.empty(), "--report"}})
      if (given)
        throw InputError(flag, "the network gives pictures, not denoised mosaics", "leave it out");
  if (arguments.format == "png" && target != NetworkTarget::kSrgb)
    throw InputError("--format png", "holds no float values", "use tif or exr");
}

std::vector<OutputNames> plan_denoised_files(const DenoiseArguments& arguments,
                                             NetworkTarget target, bool force) {
  std::vector<OutputNames> names(arguments.inputs.size());
  const auto plan = [&](bool wanted, const std::string& suffix, fs::path OutputNames::*name) {
    if (!wanted) return;
    const auto paths =
        output_names(arguments.inputs, arguments.folder, suffix, read_besides(arguments));
    for (std::size_t i = 0; i < paths.size(); ++i) {
      names[i].*name = paths[i];
      check_output(paths[i], force);
    }
  };
  if (target != NetworkTarget::kMosaic) {
    plan(true, "_" + network_target_name(target) + "." + arguments.format, &OutputNames::picture);
    return names;
  }
  plan(true, "_denoised." + arguments.format, &OutputNames::mosaic);
  plan(true, kRecord, &OutputNames::record);
  plan(arguments.u16, kIntegers, &OutputNames::integers);
  plan(arguments.planes, kPlanes, &OutputNames::planes);
  plan(arguments.uncertainty, kVariance, &OutputNames::variance);
  return names;
}

std::vector<fs::path> stale_files(const DenoiseArguments& arguments, const fs::path& input) {
  std::vector<fs::path> paths;
  for (const char* suffix : {kRecord, kIntegers, kPlanes, kVariance})
    paths.push_back(arguments.folder / (stem_of(input) + suffix));
  return existing_apart(paths, files_read(arguments));
}

void check_report(const DenoiseArguments& arguments, const std::vector<OutputNames>& names,
                  bool force) {
  std::vector<fs::path> written;
  for (const OutputNames& n : names)
    for (const fs::path& path : {n.picture, n.mosaic, n.record, n.integers, n.planes, n.variance})
      written.push_back(path);
  check_output_apart("--report", arguments.report, files_read(arguments), written, force);
}

}  // namespace malus::app
