// malus model from-dng: the noise model that a camera wrote into its DNG frames.
#include "model_from_dng.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/calibrate/gaussian_calibration.h"
#include "malus/image/black_levels.h"
#include "malus/io/dng_noise.h"

#include <filesystem>
#include <memory>

#include "output_check.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

struct FromDngArguments {
  RawOptions raw;
  std::filesystem::path frame, model;
};

RawFrame told_by_the_file(const std::filesystem::path& path, const FrameOptions& options) {
  try {
    return probe_frame(path, options).frame;
  } catch (const InputError& error) {
    throw InputError(error.subject(), error.problem(),
                     "its noise profile can be had without its pixels: give --layout, --black and "
                     "--white, and --iso or --gain");
  }
}

// Layout and levels from the flags alone where they say everything, so that frames whose
// compression nobody here decodes serve too; else from the file.
RawFrame layout_and_levels(const std::filesystem::path& path, const FrameOptions& options) {
  if (!options.layout || options.black_dn.empty() || !options.white_dn)
    return told_by_the_file(path, options);
  RawFrame frame;
  frame.layout = *options.layout;
  frame.black_dn = black_per_channel(options.black_dn, frame.layout, path.string());
  frame.white_dn = *options.white_dn;
  frame.gain = options.gain;
  return frame;
}

void run_from_dng(const FromDngArguments& arguments, const Common& common) {
  std::vector<fs::path> read = arguments.raw.files_read();
  read.push_back(arguments.frame);
  check_output_apart("--output", arguments.model, read, {}, common.force);
  const DngNoiseProfile profile = read_dng_noise_profile(arguments.frame);
  NoiseModel model =
      gaussian_model_of(profile, layout_and_levels(arguments.frame, arguments.raw.resolve()));
  model.origin = "NoiseProfile of " + arguments.frame.filename().string();
  save_model(model, arguments.model, common.force);
  const GaussianCalibration& g = model.gaussian.front();
  print_result(
      common,
      {{"model", arguments.model.string()},
       {"frame", arguments.frame.string()},
       {"slope_dn", g.slope_dn},
       {"offset_dn2", g.offset_dn2}},
      fmt::format("{}: variance {:.4g} DN s + {:.4g} DN² in channel {}\n", arguments.model.string(),
                  g.slope_dn.front(), g.offset_dn2.front(), model.layout.channel_name(0)));
}

}  // namespace

void add_model_from_dng(CLI::App& model, Common& common) {
  const auto arguments = std::make_shared<FromDngArguments>();
  CLI::App* command =
      add_command(model, common, "from-dng", "Gaussian model from the NoiseProfile of a DNG frame",
                  {.force = true}, [arguments, &common] { run_from_dng(*arguments, common); });
  command->add_option("FRAME", arguments->frame, "DNG frame; its gain is the model's")->required();
  command->add_option("-o,--output", arguments->model, "model file to write")->required();
  arguments->raw.add_to(*command, {.means = false});
}

}  // namespace malus::app
