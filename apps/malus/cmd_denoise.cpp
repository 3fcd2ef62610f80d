// malus denoise: raw frames to denoised raw frames, with a calibrated noise model or with the noise
// estimated from each picture.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/stopwatch.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/saturated_pixels.h"
#include "malus/io/picture_file.h"
#include "malus/noise/model.h"
#include "malus/noise/sensor_window.h"
#include "malus/synthesize/exact.h"

#include <filesystem>
#include <memory>
#include <optional>
#include <utility>
#include <vector>

#include "denoise_checks.h"
#include "denoise_files.h"
#include "denoise_method.h"
#include "denoise_plan.h"
#include "denoise_run.h"
#include "flags.h"
#include "frame_input.h"
#include "output_check.h"
#include "program.h"
#include "raw_options.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

// The noise that is taken out, and in words where it comes from.
struct ProfileChoice {
  NoiseProfile profile;
  std::string origin;
};

ProfileChoice choose_profile(const RawFrame& frame, const std::optional<NoiseModel>& model,
                             const DenoiseArguments& arguments, const FrameDenoiser& denoiser) {
  if (model) {
    GainSetting gain = frame.gain;
    if (!gain.decibel() && model->physics.size() == 1) gain = model->physics.front().gain;
    const GainRange range = gain_range(arguments.extrapolate_gain);
    ProfileChoice choice{
        naming_model(arguments.model, [&] { return denoising_profile_for(frame, *model, range); }),
        fmt::format("model {} at {}", arguments.model.string(), gain.text())};
    if (arguments.settings.fixed_pattern) choice.profile.pattern = fixed_pattern_at(*model, gain);
    std::optional<SensorPlace> place;
    if (!arguments.origin.empty()) place = SensorPlace{arguments.origin[0], arguments.origin[1]};
    const std::string left_out =
        fit_to_sensor(choice.profile, frame, place, arguments.settings.defects);
    if (!left_out.empty()) warn_of(frame.source, left_out);
    warn_of_model(*model, gain, arguments.model, denoiser.undoes_cut_off());
    return choice;
  }
  PictureNoise noise = require_estimate(
      frame, "give a noise model with --model (malus model list names the built-in ones)");
  warn(fmt::format("{}: {}; a calibrated model (--model) is better", frame.source, noise.trust));
  return {std::move(noise.profile), std::move(noise.trust)};
}

Json run_json(const RawFrame& frame, const Denoised& result, const ProfileChoice& choice,
              const DenoiseArguments& arguments, double seconds) {
  Json json{{"input", frame.source},
            {"rows", result.dn_above_black.rows()},
            {"cols", result.dn_above_black.cols()},
            {"layout", frame.layout.name()},
            {"channels", frame.layout.channel_names()},
            {"gain", frame.gain.text()},
            {"settings", settings_json(arguments.settings)},
            {"noise", choice.origin},
            {"noise_estimated_from_picture", choice.profile.estimated_from_picture},
            {"frame_noise", noise_json(result)}};
  json.update(settings_json(result));
  json["seconds"] = seconds;
  if (!arguments.origin.empty()) json["origin_row_col"] = arguments.origin;
  for (const StageTime& time : result.times) json["stage_seconds"][time.stage] = time.seconds;
  return json;
}

// One frame's part of the job.
struct FrameJob {
  fs::path input;
  Reference reference;  ///< its path may be empty
  OutputNames names;
  std::vector<fs::path> stale;  ///< to be removed as the result is replaced
  bool last = false;            ///< no other needs the model's maps
};

// A frame to denoise. The denoiser takes the pixels, so `described` is the frame without them.
struct OpenedFrame {
  RawFrame frame, described;
  ProfileChoice choice;
};

OpenedFrame open_frame(const DenoiseArguments& arguments, const FrameDenoiser& denoiser,
                       std::optional<NoiseModel>& model, const FrameJob& job,
                       const FrameOptions& options) {
  OpenedFrame opened;
  opened.frame = load_frame(
      job.input,
      options_for_file(job.input, model ? options_for_model(options, *model, job.input) : options,
                       arguments.raw.float_black()));
  opened.choice = choose_profile(opened.frame, model, arguments, denoiser);
  if (model && job.last) drop_maps(*model);
  warn_of_guesses(opened.frame);
  // The result does not: beside what is clipped estimates may lie above it.
  const bool white_shows = opened.frame.white_known || clips_at_white(opened.frame);
  Image pixels = std::move(opened.frame.dn);
  opened.described = opened.frame;
  opened.described.white_known = white_shows;
  opened.frame.dn = std::move(pixels);
  return opened;
}

Json process_picture(const DenoiseArguments& arguments, const FrameDenoiser& denoiser,
                     std::optional<NoiseModel>& model, const FrameJob& job,
                     const FrameOptions& options, Progress& progress, bool force) {
  OpenedFrame opened = open_frame(arguments, denoiser, model, job, options);
  const Stopwatch stopwatch;
  NetworkInference::Rendered result =
      denoiser.render(std::move(opened.frame), opened.choice.profile, progress);
  Json run =
      run_json(opened.described, result.report, opened.choice, arguments, stopwatch.seconds());
  warn_of_picture(opened.described.source, result);
  run["rows"] = result.picture.rows();
  run["cols"] = result.picture.cols();
  run["network"] = denoiser.description();
  run["target"] = denoiser.target();
  run["scale_dn"] = result.scale_dn;
  save_result_picture(job.names.picture, std::move(result.picture), denoiser.target(), force);
  run["files"] = {job.names.picture.string()};
  run["warnings"] = take_warnings();
  return run;
}

Json process_mosaic(const DenoiseArguments& arguments, const FrameDenoiser& denoiser,
                    std::optional<NoiseModel>& model, const FrameJob& job,
                    const FrameOptions& options, Progress& progress, bool force,
                    std::vector<DenoisedFrame>* report) {
  OpenedFrame opened = open_frame(arguments, denoiser, model, job, options);
  ProfileChoice& choice = opened.choice;
  if (arguments.u16)
    check_integers(opened.described, choice.profile,
                   "leave --u16 out, or bring the frame to a camera's DN (--black, --white)");
  const bool compared = !job.reference.path.empty();
  DenoisedFrame kept;
  kept.profile = choice.profile;
  kept.profile.pattern = nullptr;  // as large as a frame, and no part of what is reported
  kept.before = std::move(opened.described);
  kept.before.dn = std::move(opened.frame.dn);
  if (compared) {
    add_reference(kept, job.reference, arguments.raw.float_black() == FloatBlack::kHolds);
    measure_before(kept);
  }
  // A copy of the pixels is kept only where somebody looks at it.
  opened.frame.dn = report ? kept.before.dn : std::exchange(kept.before.dn, {});
  const Stopwatch stopwatch;
  const auto held = static_cast<double>(kept.before.dn.size() + kept.reference_dn.size()) +
                    (model ? map_values(*model) : 0.0);
  Denoised result = denoiser(std::move(opened.frame), choice.profile, progress, held);
  choice.profile.pattern = nullptr;
  const Json network = denoiser.description();
  warn_of_result(kept.before, result, choice.profile,
                 network.is_null() ? "" : arguments.settings.method);
  kept.run = run_json(kept.before, result, choice, arguments, stopwatch.seconds());
  if (arguments.u16 && result.nonfinite_pixels > 0)
    warn_of(kept.before.source, fmt::format("--u16 writes pixels that hold no light {}",
                                            fate_of_nonfinite(/*as_float=*/false)));
  if (!network.is_null()) kept.run["network"] = network;
  for (const fs::path& path : job.stale) fs::remove(path);
  kept.run["files"] = write_outputs(kept.before, choice.profile, result, job.names, force);
  kept.after_dn = std::move(result.dn_above_black);
  if (result.variance_dn2) kept.variance_dn2 = std::move(*result.variance_dn2);
  if (compared) {
    measure_after(kept);
    kept.run["against_reference"] = metrics_json(kept);
  }
  kept.run["warnings"] = take_warnings();
  Json record = run_record(kept.before, choice.profile, job.input, options.raw_format,
                           job.names.mosaic, kept.run);
  if (compared) name_reference(record, job.reference, job.names.mosaic);
  // Beside its result, so that a report can be made of it later.
  write_file(job.names.record, json_utf8(record, 2) + "\n", force);
  const Json run = kept.run;
  if (report) report->push_back(std::move(kept));
  return run;
}

// What no file could make go together.
void check_usage(const DenoiseArguments& arguments) {
  if (arguments.uncertainty) check_states_error("--uncertainty", arguments.settings.method);
  if (!arguments.references.empty() && arguments.references.size() != arguments.inputs.size())
    throw CLI::ValidationError("--reference", "one file per RAW, in the same order");
}

// One frame's record where one was asked for, else those of the frames that were finished.
void print_runs(const DenoiseArguments& arguments, const Json& runs, const Common& common) {
  std::string text;
  for (const Json& run : runs) text += run_text(run, arguments.settings.method);
  print_result(common, arguments.inputs.size() == 1 ? runs.front() : Json{{"frames", runs}}, text);
}

void run_denoise(const DenoiseArguments& arguments, const Common& common) {
  check_usage(arguments);
  const FrameDenoiser denoiser(arguments.settings, arguments.inference, arguments.uncertainty);
  if (!denoiser.precision_complaint().empty()) warn(denoiser.precision_complaint());
  denoiser.require_used(given_settings<InferenceSettings>(*arguments.command));
  check_result_flags(arguments, denoiser.target());
  std::optional<NoiseModel> model;
  const FrameOptions options = arguments.raw.resolve();
  if (!arguments.model.empty()) model = load_model(arguments.model);
  const OutputFolder output(arguments.folder);
  const std::vector<OutputNames> names =
      plan_denoised_files(arguments, denoiser.target(), common.force);
  check_report(arguments, names, common.force);
  const fs::path untold =
      check_inputs(arguments.inputs, arguments.references, options, model.has_value());
  if (model && !untold.empty())
    note(common, fmt::format("{}: layout not told, taken as the model's, {} (--layout)",
                             untold.string(), model->layout.name()));
  std::vector<DenoisedFrame> report;
  const auto progress = make_progress(common);
  Json results = Json::array();
  const auto process = [&](std::size_t i) {
    check_stop(*progress);
    const FrameJob job{
        arguments.inputs[i],
        {arguments.references.empty() ? fs::path() : arguments.references[i],
         arguments.reference_ratio, arguments.reference_black_dn},
        names[i],
        common.force ? stale_files(arguments, arguments.inputs[i]) : std::vector<fs::path>(),
        i + 1 == arguments.inputs.size()};
    results.push_back(
        denoiser.target() == "mosaic"
            ? process_mosaic(arguments, denoiser, model, job, options, *progress, common.force,
                             arguments.report.empty() ? nullptr : &report)
            : process_picture(arguments, denoiser, model, job, options, *progress, common.force));
  };
  try {
    for (std::size_t i = 0; i < arguments.inputs.size(); ++i) process(i);
    if (!arguments.report.empty()) write_denoise_report(report, arguments.report, common.force);
  } catch (...) {  // the results of the frames before are there, and this says which
    if (!results.empty()) print_runs(arguments, results, common);
    throw;
  }
  print_runs(arguments, results, common);
}

}  // namespace

void add_denoise(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<DenoiseArguments>();
  CLI::App* command =
      add_command(app, common, "denoise", "Take the noise out of raw frames", {.force = true},
                  [arguments, &common] { run_denoise(*arguments, common); });
  arguments->command = command;
  command->add_option("RAW", arguments->inputs, "mosaics")->required();
  auto* model = command->add_option(
      "--model", arguments->model,
      "noise model: a file or a built-in name; without it the noise is estimated "
      "from each picture");
  command->add_option("-o,--output", arguments->folder, "folder of the results")->required();
  command
      ->add_option("--format", arguments->format,
                   "ending of the denoised mosaic, or of a network's picture (srgb: 16 bit in tif "
                   "and png)")
      ->check(one_of({"tif", "png", "exr", "npy", "fits"}))
      ->capture_default_str();
  command->add_flag("--planes", arguments->planes, "also the packed planes as EXR");
  command->add_flag("--uncertainty", arguments->uncertainty,
                    "also the variance of every pixel [DN^2], packed, as EXR");
  command->add_flag("--u16", arguments->u16, "also an integer raw with the black level put back");
  command->add_option("--report", arguments->report, "also a report page (HTML)");
  auto* references =
      command->add_option("--reference", arguments->references,
                          "the clean mosaic of each frame's scene: metrics are reported");
  command
      ->add_option("--reference-ratio", arguments->reference_ratio,
                   "how much more light the references had")
      ->check(positive_number())
      ->capture_default_str()
      ->needs(references);
  command
      ->add_option(
          "--reference-black", arguments->reference_black_dn,
          "their black level [DN] where their files tell none (else the frames', of floats 0)")
      ->needs(references);
  command
      ->add_option("--origin", arguments->origin,
                   "row,column on the calibrated sensor of the first pixel, where RAW is a part "
                   "of it: for the model's defects and fixed pattern")
      ->delimiter(',')
      ->expected(2)
      ->needs(model)
      ->check(in_range(0, kLastPosition));
  command
      ->add_flag("--extrapolate-gain", arguments->extrapolate_gain,
                 "allow a gain outside the calibrated range")
      ->needs(model);
  arguments->raw.add_to(*command);
  add_flags(*command, arguments->settings);
  command->get_option("--method")
      ->description("nl-ridge (the default), bm3d, a baseline, or a network's file")
      ->check(accepted_by(require_method));
  add_flags(*command, arguments->inference);
}

}  // namespace malus::app
