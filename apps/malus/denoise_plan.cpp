#include "denoise_plan.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"

#include <utility>

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

// Of a mosaic as of a picture; a mosaic's .png is somebody's view of it.
std::vector<std::string> formats_of(NetworkTarget target) {
  std::vector<std::string> formats = denoised_formats();
  if (target != NetworkTarget::kSrgb) std::erase(formats, "png");
  return formats;
}

// result: the mosaic or the picture.
std::vector<fs::path> stale_files(const DenoiseArguments& arguments, const fs::path& input,
                                  const fs::path& result, NetworkTarget target, bool force) {
  const std::vector<fs::path> read = files_read(arguments);
  std::vector<fs::path> stale = left_in_other_formats(result, formats_of(target), read, force);
  if (!force || target != NetworkTarget::kMosaic) return stale;
  std::vector<fs::path> parts;
  for (const char* suffix : {kRecord, kIntegers, kPlanes, kVariance})
    parts.push_back(arguments.folder / (stem_of(input) + suffix));
  parts = existing_apart(parts, read);
  stale.insert(stale.end(), parts.begin(), parts.end());
  return stale;
}

}  // namespace

std::vector<std::string> denoised_formats() { return {"tif", "png", "exr", "npy", "fits"}; }

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
    throw InputError("--format png", "holds no float values", "use tif, exr, npy or fits");
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
  const auto plan_stale = [&](fs::path OutputNames::*result) {
    for (std::size_t i = 0; i < names.size(); ++i)
      names[i].stale = stale_files(arguments, arguments.inputs[i], names[i].*result, target, force);
  };
  if (target != NetworkTarget::kMosaic) {
    plan(true, "_" + network_target_name(target) + "." + arguments.format, &OutputNames::picture);
    plan_stale(&OutputNames::picture);
    return names;
  }
  plan(true, "_denoised." + arguments.format, &OutputNames::mosaic);
  plan(true, kRecord, &OutputNames::record);
  plan(arguments.u16, kIntegers, &OutputNames::integers);
  plan(arguments.planes, kPlanes, &OutputNames::planes);
  plan(arguments.uncertainty, kVariance, &OutputNames::variance);
  plan_stale(&OutputNames::mosaic);
  return names;
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
