// malus denoise: raw frames to denoised raw frames, with a calibrated noise model or with the noise
// estimated from each picture.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/stopwatch.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/estimate_noise.h"
#include "malus/denoise/frame_profile.h"
#include "malus/denoise/saturated_pixels.h"
#include "malus/io/picture_file.h"
#include "malus/noise/model.h"
#include "malus/noise/sensor_window.h"

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
#include "freed_memory.h"
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

// The frame's, at its gain. Errors name the model's file too, but for those of the frame alone.
NoiseProfile profile_by_model(const RawFrame& frame, const NoiseModel& model,
                              const DenoiseArguments& arguments) {
  std::optional<SensorPlace> place;
  if (!arguments.origin.empty()) place = SensorPlace{arguments.origin[0], arguments.origin[1]};
  try {
    FrameProfile made = frame_profile(frame, model, frame.gain, arguments.settings, place,
                                      gain_range(arguments.extrapolate_gain));
    for (const std::string& line : {made.left_out, made.unseen})
      if (!line.empty()) warn_of(frame.source, line);
    return std::move(made.profile);
  } catch (const InputError& error) {
    if (error.subject() == frame.source) throw;
    throw InputError(
        fmt::format("{}: {}: {}", arguments.model.string(), frame.source, error.subject()),
        error.problem(), error.remedy());
  }
}

ProfileChoice choose_profile(const RawFrame& frame, const std::optional<NoiseModel>& model,
                             const DenoiseArguments& arguments, const FrameDenoiser& denoiser) {
  if (model) {
    GainSetting gain = frame.gain;
    if (!gain.decibel() && model->physics.size() == 1) gain = model->physics.front().gain;
    ProfileChoice choice{profile_by_model(frame, *model, arguments),
                         fmt::format("model {} at {}", arguments.model.string(), gain.text())};
    warn_of_model(*model, gain, arguments.model, denoiser.undoes_cut_off());
    return choice;
  }
  PictureNoise noise = require_estimate(
      frame, "give a noise model with --model (malus model list names the built-in ones)");
  warn(fmt::format("{}: {}", frame.source, noise.trust));
  warn_of(
      frame.source,
      fmt::format("{}; {}a calibrated model (--model) is better", kPictureNoiseLimits,
                  arguments.raw.has_dark() ? "" : "--dark with a frame of the capped lens, or "));
  return {std::move(noise.profile), std::move(noise.trust)};
}

// One frame's part of the job.
struct FrameJob {
  fs::path input;
  Reference reference;  ///< its path may be empty
  OutputNames names;
  bool last = false;  ///< no other needs the model's maps
};

// A frame to denoise. The denoiser takes the pixels, so `described` is the frame without them.
struct OpenedFrame {
  RawFrame frame, described;
  ProfileChoice choice;
};

// What is printed of a frame, as JSON or for people.
struct FrameRecord {
  Json json;
  std::string text;
};

// Frame by frame through one denoiser.
class DenoiseRun {
 public:
  // report: takes the frames where a page is made of them, else null.
  DenoiseRun(const DenoiseArguments& arguments, const FrameDenoiser& denoiser,
             const FrameOptions& options, std::optional<NoiseModel> model,
             std::vector<DenoisedFrame>* report, Progress& progress, bool force)
      : arguments_(arguments),
        denoiser_(denoiser),
        options_(options),
        model_(std::move(model)),
        report_(report),
        progress_(progress),
        force_(force) {}

  FrameRecord process(const FrameJob& job) {
    check_stop(progress_);
    OpenedFrame opened = open(job);
    if (model_ && job.last) drop_maps(*model_);
    return denoiser_.target() == NetworkTarget::kMosaic ? process_mosaic(job, opened)
                                                        : process_picture(job, opened);
  }

 private:
  OpenedFrame open(const FrameJob& job) const {
    OpenedFrame opened;
    opened.frame = load_frame(
        job.input,
        options_for_file(job.input,
                         model_ ? options_for_model(options_, *model_, job.input) : options_,
                         arguments_.raw.float_black()));
    opened.choice = choose_profile(opened.frame, model_, arguments_, denoiser_);
    warn_of_guesses(opened.frame);
    if (!model_ && probe_frame(job.input, headerless_part(options_)).holds == kHoldsDenoised)
      warn_of(opened.frame.source, kDenoisedAgain);
    // The result does not: beside what is clipped estimates may lie above it.
    const bool white_shows = opened.frame.white_known || clips_at_white(opened.frame);
    Image pixels = std::move(opened.frame.dn);
    opened.described = opened.frame;
    opened.described.white_known = white_shows;
    opened.frame.dn = std::move(pixels);
    return opened;
  }

  FrameRecord process_picture(const FrameJob& job, OpenedFrame& opened) const {
    const Stopwatch stopwatch;
    NetworkInference::Rendered result =
        denoiser_.render(std::move(opened.frame), opened.choice.profile, progress_);
    const RunSummary summary{opened.described, result.report, result.picture.rows(),
                             result.picture.cols(), stopwatch.seconds()};
    Json run = run_json(summary, opened.choice);
    warn_of_picture(opened.described.source, result);
    run["network"] = denoiser_.description();
    run["target"] = network_target_name(denoiser_.target());
    run["scale_dn"] = result.scale_dn;
    for (const fs::path& path : job.names.stale) fs::remove(path);
    save_result_picture(job.names.picture, std::move(result.picture), denoiser_.target(), force_);
    run["files"] = {job.names.picture.string()};
    run["warnings"] = take_warnings();
    return {std::move(run), run_text(summary, arguments_.settings.method, job.names.picture)};
  }

  FrameRecord process_mosaic(const FrameJob& job, OpenedFrame& opened) {
    ProfileChoice& choice = opened.choice;
    if (arguments_.u16)
      check_integers(opened.described, choice.profile,
                     "leave --u16 out, or bring the frame to a camera's DN (--black, --white)");
    DenoisedFrame kept = take_before(job, opened);
    const Stopwatch stopwatch;
    const auto held = static_cast<double>(kept.before.dn.size() + kept.reference_dn.size()) +
                      (model_ ? map_values(*model_) : 0.0);
    Denoised result = denoiser_(std::move(opened.frame), choice.profile, progress_, held);
    choice.profile.pattern = nullptr;
    const RunSummary summary{kept.before, result, result.dn_above_black.rows(),
                             result.dn_above_black.cols(), stopwatch.seconds()};
    const Json network = denoiser_.description();
    warn_of_result(kept.before, result, choice.profile,
                   network.is_null() ? "" : arguments_.settings.method);
    if (arguments_.u16 && result.nonfinite_pixels > 0)
      warn_of(kept.before.source, fmt::format("--u16 writes pixels that hold no light {}",
                                              fate_of_nonfinite(/*as_float=*/false)));
    kept.run = run_json(summary, choice);
    if (!network.is_null()) kept.run["network"] = network;
    for (const fs::path& path : job.names.stale) fs::remove(path);
    kept.run["files"] = write_outputs(kept.before, choice.profile, result, job.names, force_);
    kept.after_dn = std::move(result.dn_above_black);
    if (result.variance_dn2) kept.variance_dn2 = std::move(*result.variance_dn2);
    if (kept.reference_dn.size() > 0) {
      measure_after(kept);
      kept.run["against_reference"] = metrics_json(kept);
    }
    kept.run["warnings"] = take_warnings();
    write_record(job, kept);
    FrameRecord record{kept.run, run_text(summary, arguments_.settings.method, job.names.mosaic) +
                                     metrics_text(kept)};
    if (report_) report_->push_back(std::move(kept));
    return record;
  }

  // What is known before the frame is denoised, with a copy of the pixels only where somebody looks
  // at it.
  DenoisedFrame take_before(const FrameJob& job, OpenedFrame& opened) const {
    DenoisedFrame kept;
    kept.profile = opened.choice.profile;
    kept.profile.pattern = nullptr;  // as large as a frame, and no part of what is reported
    kept.before = std::move(opened.described);
    kept.before.dn = std::move(opened.frame.dn);
    if (!job.reference.path.empty()) {
      add_reference(kept, job.reference, arguments_.raw.float_black() == FloatBlack::kHolds);
      measure_before(kept);
    }
    opened.frame.dn = report_ ? kept.before.dn : std::exchange(kept.before.dn, {});
    return kept;
  }

  Json run_json(const RunSummary& run, const ProfileChoice& choice) const {
    Json json{{"input", run.frame.source},
              {"rows", run.rows},
              {"cols", run.cols},
              {"layout", run.frame.layout.name()},
              {"channels", run.frame.layout.channel_names()},
              {"gain", run.frame.gain.text()},
              {"mean_of", run.frame.mean_of},
              {"settings", settings_json(arguments_.settings)},
              {"noise", choice.origin},
              {"noise_estimated_from_picture", choice.profile.estimated_from_picture},
              {"frame_noise", noise_json(run.result)}};
    if (!run.result.noise)
      json["frame_noise_missing"] = choice.profile.estimated_from_picture
                                        ? "the noise is the frame's own"
                                        : "too small, or half of it of one value";
    json.update(settings_json(run.result));
    json["seconds"] = run.seconds;
    if (!arguments_.origin.empty()) json["origin_row_col"] = arguments_.origin;
    for (const StageTime& time : run.result.times) json["stage_seconds"][time.stage] = time.seconds;
    return json;
  }

  // Beside the result, so that a report can be made of it later.
  void write_record(const FrameJob& job, const DenoisedFrame& kept) const {
    Json record = run_record(kept.before, kept.profile, job.input, options_.raw_format,
                             job.names.mosaic, kept.run);
    if (!job.reference.path.empty()) name_reference(record, job.reference, job.names.mosaic);
    if (!job.names.variance.empty()) name_variance(record, job.names.variance, job.names.mosaic);
    write_file(job.names.record, json_utf8(record, 2) + "\n", force_);
  }

  const DenoiseArguments& arguments_;
  const FrameDenoiser& denoiser_;
  const FrameOptions& options_;
  std::optional<NoiseModel> model_;
  std::vector<DenoisedFrame>* report_;
  Progress& progress_;
  bool force_;
};

// What no file could make go together.
void check_usage(const DenoiseArguments& arguments) {
  if (!is_weight_file(arguments.settings.method) && arguments.format == "png")
    throw CLI::ValidationError("--format png", "holds no float values; use tif, exr, npy or fits");
  if (arguments.uncertainty) check_states_error("--uncertainty", arguments.settings.method);
}

// What a network does with them its file tells; of other methods they are wrong usage.
void require_used(const FrameDenoiser& denoiser, const DenoiseArguments& arguments) {
  const auto require = [&] {
    denoiser.require_used(given_settings<InferenceSettings>(*arguments.command));
    denoiser.require_used_of_filter(given_settings<DenoiseSettings>(*arguments.command));
  };
  if (is_weight_file(arguments.settings.method))
    require();
  else
    as_usage(require);
}

// A stack's frames are denoised one by one.
void take_frames(DenoiseArguments& arguments, const FrameOptions& options) {
  arguments.inputs = frames_of_inputs(arguments.inputs, options);
  arguments.references = frames_of_inputs(arguments.references, {});
  if (!arguments.references.empty() && arguments.references.size() != arguments.inputs.size())
    throw CLI::ValidationError("--reference", "one frame per RAW, in the same order");
}

// One frame's record where one was asked for, else those of the frames that were finished.
void print_records(const DenoiseArguments& arguments, const std::vector<FrameRecord>& records,
                   const Common& common) {
  std::string text;
  Json all = Json::array();
  for (const FrameRecord& record : records) {
    text += record.text;
    all.push_back(record.json);
  }
  print_frames(common, all, arguments.inputs.size(), text);
}

void run_denoise(DenoiseArguments arguments, const Common& common) {
  keep_freed_planes();
  check_usage(arguments);
  const FrameOptions options = arguments.raw.resolve();
  take_frames(arguments, options);
  const FrameDenoiser denoiser(arguments.settings, arguments.inference, arguments.uncertainty);
  if (!denoiser.precision_complaint().empty()) warn(denoiser.precision_complaint());
  require_used(denoiser, arguments);
  check_result_flags(arguments, denoiser.target());
  std::optional<NoiseModel> model;
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
  DenoiseRun run(arguments, denoiser, options, std::move(model),
                 arguments.report.empty() ? nullptr : &report, *progress, common.force);
  std::vector<FrameRecord> records;
  const auto work = [&] {
    for (std::size_t i = 0; i < arguments.inputs.size(); ++i)
      records.push_back(
          run.process({arguments.inputs[i],
                       {arguments.references.empty() ? fs::path() : arguments.references[i],
                        arguments.reference_ratio, arguments.reference_black_dn},
                       names[i],
                       i + 1 == arguments.inputs.size()}));
    if (!arguments.report.empty()) write_denoise_report(report, arguments.report, common.force);
  };
  work_and_print(work, [&] { print_records(arguments, records, common); });
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
      ->check(one_of(denoised_formats()))
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
      ->check(finite_number())
      ->needs(references);
  add_origin(*command, arguments->origin,
             "row,column on the calibrated sensor of the first pixel, where RAW is a part of it: "
             "for the model's defects and fixed pattern")
      ->needs(model);
  command
      ->add_flag("--extrapolate-gain", arguments->extrapolate_gain,
                 "allow a gain outside the calibrated range")
      ->needs(model);
  arguments->raw.add_to(*command, {.dark = true});
  command->get_option("--dark")->excludes(model);
  add_flags(*command, arguments->settings);
  command->get_option("--method")
      ->description(fmt::format("nl-ridge (the default), bm3d, a network's file, or a baseline: {}",
                                baseline_names()))
      ->check(accepted_by(require_method));
  add_flags(*command, arguments->inference);
}

}  // namespace malus::app
