// malus renoise: noisy frames taken at one gain, made to look like frames of a noisier gain (001,
// S6).
#include "malus/base/atomic_file.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/frame_profile.h"
#include "malus/image/frame_mean.h"
#include "malus/io/picture_file.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/model.h"
#include "malus/synthesize/model_renoiser.h"

#include <filesystem>
#include <memory>
#include <type_traits>
#include <vector>

#include "denoise_files.h"
#include "flags.h"
#include "frame_input.h"
#include "output_check.h"
#include "program.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct RenoiseArguments {
  RawOptions raw;
  std::vector<fs::path> inputs, guides;
  fs::path model, folder;
  double from = 0, to = 0;
  RenoiseSettings settings;
  DenoiseSettings guide;  ///< where none is given
  std::string format = "tif";
  std::uint32_t first_frame = 0;
  bool as_float = false;
};

// The clean signal as a denoiser sees it: only the noise level is taken from it. It keeps the fixed
// pattern, which both gains have: a pixel's shot noise is that of what it collects itself.
Image guide_of(const RenoiseArguments& arguments, std::size_t index, const RawFrame& frame,
               const NoiseModel& model, const GainSetting& gain, Progress& progress) {
  if (arguments.guides.empty()) {
    DenoiseSettings settings = arguments.guide;
    settings.held_values = static_cast<double>(frame.dn.size());
    return denoise_frame(frame, denoising_profile(frame, model, gain), settings, progress)
        .dn_above_black;
  }
  FrameOptions options = options_in_layout({}, model.layout, arguments.guides[index]);
  options.rows = frame.dn.rows();
  options.cols = frame.dn.cols();
  RawFrame guide = load_frame(arguments.guides[index], options);
  check_finite(guide.dn, guide.source,
               fate_in_guide(arguments.settings.method, arguments.as_float));
  subtract_black(guide);
  return std::move(guide.dn);
}

RawFrame load_noisy(const RenoiseArguments& arguments, const fs::path& input,
                    const FrameOptions& options, const NoiseModel& model, const GainSetting& from) {
  FrameInfo info =
      load_frame_info(input, options_for_file(input, options_for_model(options, model, input),
                                              arguments.raw.float_black()));
  require_raw(input.string(), info.holds, "give the raw frame");
  RawFrame& frame = info.frame;
  require_single(frame);
  require_gain(frame, from, "--from");
  if (shows_noisy_frame(arguments.settings.method, !arguments.guides.empty()))
    check_finite(frame.dn, frame.source, fate_of_nonfinite(arguments.as_float));
  return std::move(frame);
}

RawFrame renoised_frame(const RenoiseArguments& arguments, const NoiseModel& model,
                        const GainSetting& to, Image dn) {
  RawFrame out;
  out.layout = model.layout;
  out.gain = to;
  out.black_known = out.white_known = out.layout_known = true;
  if (arguments.as_float) {
    out.black_dn.assign(model.black_dn.size(), 0.0);
    out.white_dn = white_above_black(model.white_dn, model.black_dn);
  } else {
    out.black_dn = model.black_dn;
    out.white_dn = model.white_dn;
    out.bits = 16;
  }
  out.dn = std::move(dn);
  return out;
}

SampleType sample_type(const RenoiseArguments& arguments) {
  return arguments.as_float ? SampleType::kFloat : SampleType::kUint16;
}

std::vector<std::string> renoised_formats() { return {"tif", "png", "fits", "npy", "exr"}; }

// A stack's frames are taken one by one.
void take_noisy_frames(RenoiseArguments& arguments, const FrameOptions& options) {
  arguments.inputs = frames_of_inputs(arguments.inputs, options);
  arguments.guides = frames_of_inputs(arguments.guides, {});
  if (!arguments.guides.empty() && arguments.guides.size() != arguments.inputs.size())
    throw CLI::ValidationError("--guide", "one per frame, in the same order");
  as_usage([&] {
    require_numbers_left("--first-frame", arguments.first_frame, std::ssize(arguments.inputs));
  });
  require_headers(arguments.inputs, options);
}

std::vector<PlannedFile> plan_renoised_files(const RenoiseArguments& arguments,
                                             const std::vector<fs::path>& names, bool force) {
  std::vector<fs::path> read = arguments.inputs;
  read.insert(read.end(), arguments.guides.begin(), arguments.guides.end());
  std::vector<PlannedFile> plans;
  for (const fs::path& name : names) {
    check_output(name, force);
    plans.push_back({name, left_in_other_formats(name, renoised_formats(), read, force)});
  }
  return plans;
}

void run_renoise(RenoiseArguments arguments, const Common& common) {
  require_format_for(arguments.format, sample_type(arguments));
  const FrameOptions options = arguments.raw.resolve();
  take_noisy_frames(arguments, options);
  const NoiseModel model = load_model(arguments.model);
  const GainSetting from = model.setting_of(arguments.from), to = model.setting_of(arguments.to);
  warn_of_untold_gain(model, arguments.model, {from, to});
  if (!arguments.as_float)
    check_integers_of_camera(model, arguments.model, to, GainRange::kCalibratedOnly);
  LevelCoverage coverage;
  const ModelRenoiser renoiser = naming_model(arguments.model, [&] {
    return ModelRenoiser(model, from, to, arguments.settings, !arguments.as_float);
  });
  const auto names = output_names(arguments.inputs, arguments.folder,
                                  "_renoised." + arguments.format, arguments.guides);
  const OutputFolder output(arguments.folder);
  const std::vector<PlannedFile> plans = plan_renoised_files(arguments, names, common.force);
  const auto progress = make_progress(common);
  Json frames = Json::array();
  std::string text;
  SaveOptions save;
  save.force = common.force;
  save.type = sample_type(arguments);
  const auto work = [&] {
    for (std::size_t i = 0; i < plans.size(); ++i) {
      check_stop(*progress);
      const fs::path& input = arguments.inputs[i];
      RawFrame frame = load_noisy(arguments, input, options, model, from);
      Image result = guide_of(arguments, i, frame, model, from, *progress);
      subtract_black(frame);
      const DrawAddress address{.seed = common.seed,
                                .frame = arguments.first_frame + static_cast<std::uint32_t>(i)};
      coverage.add(renoiser.apply(frame.dn, result, address));
      for (const fs::path& path : plans[i].stale) fs::remove(path);
      save_frame(plans[i].name, renoised_frame(arguments, model, to, std::move(result)), save);
      frames.push_back({{"input", arguments.inputs[i].string()},
                        {"output", plans[i].name.string()},
                        {"frame", address.frame}});
      text += fmt::format("{} <- {}: {} -> {}\n", plans[i].name.string(),
                          arguments.inputs[i].string(), from.text(), to.text());
    }
  };
  const auto print = [&] {
    if (frames.empty()) return;
    if (const std::string complaint = coverage.complaint(); !complaint.empty()) warn(complaint);
    print_result(common,
                 {{"model", arguments.model.string()},
                  {"from", from.text()},
                  {"to", to.text()},
                  {"method", arguments.settings.method},
                  {"kind", arguments.settings.kind},
                  {"seed", common.seed},
                  {"frames", frames}},
                 text);
  };
  work_and_print(work, print);
}

}  // namespace

void add_renoise(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<RenoiseArguments>();
  CLI::App* command = add_command(
      app, common, "renoise", "Noisy frames of one gain as if taken at a noisier one",
      {.seed = true, .force = true}, [arguments, &common] { run_renoise(*arguments, common); });
  command->add_option("NOISY", arguments->inputs, "raw mosaics")->required();
  command->add_option("-m,--model", arguments->model, "noise model: a file or a built-in name")
      ->required();
  command
      ->add_option("--from", arguments->from, "gain of the frames, in the model's unit (dB or ISO)")
      ->check(finite_number())
      ->required();
  command->add_option("--to", arguments->to, "gain to imitate")->check(finite_number())->required();
  command->add_option("-o,--output", arguments->folder, "folder of the results")->required();
  command->add_option("--guide", arguments->guides,
                      "denoised frames in DN above black, one per frame; otherwise made with the "
                      "calibrated denoiser");
  add_flags(*command, arguments->settings);
  command
      ->add_option("--first-frame", arguments->first_frame,
                   "number of the first frame; seed and number decide the noise")
      ->check(frame_number())
      ->capture_default_str();
  command->add_flag("--float", arguments->as_float, "write DN above black, unrounded");
  command->add_option("--format", arguments->format, "ending of the results")
      ->check(one_of(renoised_formats()))
      ->capture_default_str();
  DenoiseSettings::describe(arguments->guide, [&](auto& value, const ParameterInfo& info) {
    if constexpr (std::is_same_v<decltype(value), double&>)
      if (info.name == "memory")
        command
            ->add_option(flag_name(info.name), value, "as denoise's, while the guide is made [MiB]")
            ->check(in_range(info.minimum, info.maximum))
            ->capture_default_str();
  });
  arguments->raw.add_to(*command, {.gain = false, .means = false});
}

}  // namespace malus::app
