// malus synthesize: clean frames to noisy ones, as the camera of a noise model would take them.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/io/gain_json.h"
#include "malus/io/picture_file.h"
#include "malus/io/session.h"
#include "malus/noise/model.h"
#include "malus/noise/same_sensor.h"
#include "malus/noise/sensor_window.h"
#include "malus/synthesize/light_scale.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <filesystem>
#include <functional>
#include <iterator>
#include <memory>
#include <utility>
#include <vector>

#include "denoise_files.h"
#include "flags.h"
#include "frame_input.h"
#include "networks_door.h"
#include "output_check.h"
#include "program.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct SynthesizeArguments {
  RawOptions raw;
  SynthesisSettings settings;
  const CLI::Option* kind = nullptr;  ///< counts whether it was given
  std::vector<fs::path> inputs;
  fs::path folder, model;
  std::string gain, format = "tif";
  std::optional<double> iso;
  int frames = 1;
  std::uint32_t first_frame = 0;
  std::vector<int> origin = {0, 0};
  bool as_float = false;
};

// Empty = random.
std::optional<GainSetting> gain_of(const SynthesizeArguments& arguments) {
  if (arguments.gain == "random") return std::nullopt;
  GainSetting gain;
  gain.iso = arguments.iso;
  if (arguments.gain.empty()) return gain;
  gain.gain_db = decimal_number(arguments.gain);
  if (!gain.gain_db)
    throw CLI::ValidationError("--gain",
                               arguments.gain + " is not a gain: give a number in dB, or random");
  if (const auto fault = fault_of({gain, {}}, true))
    throw CLI::ValidationError("--gain", fault->problem + "; " + fault->remedy);
  return gain;
}

// The clean mosaic in DN above black.
Image load_clean(const fs::path& path, const SynthesizeArguments& arguments,
                 const SensorLayout& layout) {
  RawFrame frame = load_frame(path, arguments.raw.resolve());
  take_layout_of_model(frame, layout);
  if (frame.holds_codes() && !frame.black_known)
    throw InputError(path.string(), "holds integers, but its black level is not known",
                     "give --black (0 where black is subtracted already)");
  check_finite(frame.dn, path.string(), fate_of_nonfinite(arguments.as_float));
  // Float files hold DN above black already: --black is that of integers.
  if (frame.holds_codes())
    subtract_black(frame);
  else if (arguments.raw.float_black() == FloatBlack::kHolds && mean_of(frame.black_dn) != 0)
    warn(fmt::format("{}: clean float pixels are DN above black; --black is not subtracted",
                     path.string()));
  return std::move(frame.dn);
}

// Noise in DN above black, unrounded.
RawFrame float_frame(Image dn, const SensorLayout& layout, double white_dn,
                     const GainSetting& gain) {
  RawFrame frame;
  frame.dn = std::move(dn);
  frame.layout = layout;
  frame.black_dn.assign(static_cast<std::size_t>(layout.channels()), 0.0);
  frame.white_dn = white_dn;
  frame.gain = gain;
  frame.black_known = frame.white_known = frame.layout_known = true;
  return frame;
}

// One noisy frame, as it is written; coverage counts its pixels.
RawFrame draw(const Synthesizer& synthesizer, const SynthesizeArguments& arguments,
              const Image& clean, const std::optional<GainSetting>& gain,
              const DrawAddress& address, LevelCoverage& coverage) {
  const NoiseModel& model = synthesizer.model();
  const double white_dn = model.white_dn > 0 ? model.white_dn : 65535.0;
  if (!arguments.as_float) {
    FrameParameters drawn;
    RawFrame frame = synthesizer.draw_raw(clean, gain, address, model.black_dn, white_dn, &drawn);
    coverage.add(drawn.coverage);
    return frame;
  }
  SyntheticFrame noisy = synthesizer.draw(clean, gain, address);
  coverage.add(noisy.coverage);
  const SynthesisSettings& settings = synthesizer.settings();
  return float_frame(std::move(noisy.dn), model.layout,
                     (white_above_black(white_dn, model.black_dn) - noisy.global_bias_dn) *
                         (settings.amplify ? settings.ratio : 1.0),
                     noisy.gain);
}

// What draws the frames: a calibrated model, or a trained Noise Flow.
struct FrameSource {
  std::string sensor;
  SensorLayout layout;
  int row_group = 1;
  double white_dn = 0;  ///< above black; 0: not known
  std::function<RawFrame(const Image& clean, const DrawAddress& address)> draw;
  std::shared_ptr<LevelCoverage> coverage = std::make_shared<LevelCoverage>();  ///< of all drawn
  std::function<std::string(const Image& clean)> caution = [](const Image&) { return ""; };
};

FrameSource calibrated_source(const SynthesizeArguments& arguments,
                              const std::optional<GainSetting>& gain) {
  NoiseModel loaded = load_model(arguments.model);
  const auto synthesizer = naming_model(arguments.model, [&] {
    return std::make_shared<const Synthesizer>(std::move(loaded), arguments.settings);
  });
  const auto coverage = std::make_shared<LevelCoverage>();
  const NoiseModel& model = synthesizer->model();
  if (gain) warn_of_untold_gain(model, arguments.model, {*gain});
  // The scale is the same at every gain, so that of the first frame will do.
  if (!arguments.as_float)
    check_integers_of_camera(
        model, arguments.model,
        gain ? *gain : random_gain(model, arguments.settings, 0, arguments.first_frame),
        gain_range(arguments.settings.extrapolate_gain));
  return {model.sensor,
          model.layout,
          model.row_group,
          white_of_light_dn(model),
          [=, &arguments](const Image& clean, const DrawAddress& address) {
            return naming_model(arguments.model, [&] {
              return draw(*synthesizer, arguments, clean, gain, address, *coverage);
            });
          },
          coverage,
          [=](const Image& clean) { return synthesizer->repetition(clean.rows(), clean.cols()); }};
}

FrameSource flow_source(const SynthesizeArguments& arguments,
                        const std::optional<GainSetting>& gain) {
  if (arguments.kind->count() > 0)
    throw InputError("--kind " + arguments.settings.kind, "means nothing to a Noise Flow",
                     "leave it out");
  SynthesisSettings plain;
  plain.ratio = arguments.settings.ratio;
  if (settings_json(plain) != settings_json(arguments.settings))
    throw InputError("--model " + arguments.model.string(),
                     "a Noise Flow has none of the parts that these settings change",
                     "of the settings give --ratio alone");
  if (!gain)
    throw InputError("--gain random", "is not offered by a Noise Flow", "give a gain in dB");
  const std::shared_ptr<FlowSampler> flow = networks().open_flow(arguments.model);
  return {kNoiseFlowCamera, SensorLayout::named(flow->sensor().layout), 1,
          white_above_black(flow->sensor().white_dn, flow->sensor().black_dn),
          [=, &arguments](const Image& clean, const DrawAddress& address) {
            Image signal = clean;
            for (float& value : signal.values())
              value = static_cast<float>(value / arguments.settings.ratio);
            if (!arguments.as_float) return flow->draw_raw(signal.view(), *gain, address);
            const auto& sensor = flow->sensor();
            return float_frame(flow->draw(signal.view(), *gain, address),
                               SensorLayout::named(sensor.layout),
                               white_above_black(sensor.white_dn, sensor.black_dn), *gain);
          }};
}

// What is written names the layout, which begins with a whole cell.
FrameSource source_of(const SynthesizeArguments& arguments,
                      const std::optional<GainSetting>& gain) {
  const bool flow = names_noise_flow(arguments.model);
  FrameSource source = flow ? flow_source(arguments, gain) : calibrated_source(arguments, gain);
  require_whole_cells({arguments.origin[0], arguments.origin[1]}, source.layout, source.row_group,
                      arguments.inputs.front().string());
  return source;
}

SampleType sample_type(const SynthesizeArguments& arguments) {
  return arguments.as_float ? SampleType::kFloat : SampleType::kUint16;
}

std::vector<std::string> noisy_formats() { return {"tif", "png", "fits", "npy", "exr"}; }

std::vector<std::vector<PlannedFile>> plan_noisy_files(const SynthesizeArguments& arguments,
                                                       bool force) {
  std::vector<std::vector<PlannedFile>> plans(arguments.inputs.size());
  for (int n = 0; n < arguments.frames; ++n) {
    const auto names = output_names(arguments.inputs, arguments.folder,
                                    fmt::format("_{:03}.{}", n, arguments.format));
    for (std::size_t i = 0; i < names.size(); ++i) {
      check_output(names[i], force);
      plans[i].push_back(
          {names[i], left_in_other_formats(names[i], noisy_formats(), arguments.inputs, force)});
    }
  }
  return plans;
}

// "820", or every channel's where they differ.
std::string black_text(const std::vector<double>& black_dn) {
  const bool equal = std::equal(black_dn.begin() + 1, black_dn.end(), black_dn.begin());
  return fmt::format(
      "{:g}", fmt::join(black_dn.begin(), equal ? black_dn.begin() + 1 : black_dn.end(), ", "));
}

std::string frames_text(const Json& frames, bool with_black) {
  std::string text;
  for (const Json& f : frames)
    text += fmt::format(
        "{} <- {} (frame {}, {}{})\n", f["output"].get<std::string>(),
        f["input"].get<std::string>(), f["frame"].get<std::uint32_t>(), gain_from(f).text(),
        with_black ? ", black " + black_text(f["black_dn"].get<std::vector<double>>()) : "");
  return text;
}

// A stack's frames are taken one by one.
void take_clean_frames(SynthesizeArguments& arguments) {
  require_format_for(arguments.format, sample_type(arguments));
  arguments.inputs = frames_of_inputs(arguments.inputs, arguments.raw.resolve());
  as_usage([&] {
    require_numbers_left("--first-frame", arguments.first_frame,
                         std::ssize(arguments.inputs) * std::int64_t{arguments.frames});
  });
}

void run_synthesize(SynthesizeArguments arguments, const Common& common) {
  const auto gain = gain_of(arguments);
  take_clean_frames(arguments);
  const FrameSource source = source_of(arguments, gain);
  require_headers(arguments.inputs, arguments.raw.resolve());
  const OutputFolder folder(arguments.folder);
  const auto plans = plan_noisy_files(arguments, common.force);
  const auto progress = make_progress(common);
  progress->begin("synthesize",
                  static_cast<std::int64_t>(plans.size()) * std::int64_t{arguments.frames});
  SaveOptions save;
  save.force = common.force;
  save.type = sample_type(arguments);
  Json frames = Json::array();
  std::string said;
  bool scale_said = false;
  std::uint32_t number = arguments.first_frame;
  const auto work = [&] {
    for (std::size_t i = 0; i < arguments.inputs.size(); ++i) {
      const Image clean = load_clean(arguments.inputs[i], arguments, source.layout);
      if (const std::string caution = source.caution(clean); !caution.empty() && caution != said)
        warn(said = caution);
      if (const std::string line = light_scale_complaint(clean, source.white_dn);
          !line.empty() && !std::exchange(scale_said, true))
        warn_of(arguments.inputs[i].string(), line);
      for (int n = 0; n < arguments.frames; ++n, ++number) {
        check_stop(*progress);
        const RawFrame noisy = source.draw(clean, {.seed = common.seed,
                                                   .frame = number,
                                                   .row0 = arguments.origin[0],
                                                   .col0 = arguments.origin[1]});
        const auto& [output, stale] = plans[i][static_cast<std::size_t>(n)];
        for (const fs::path& path : stale) fs::remove(path);
        save_frame(output, noisy, save);
        frames.push_back({{"input", arguments.inputs[i].string()},
                          {"output", output.string()},
                          {"frame", number},
                          {"black_dn", noisy.black_dn},
                          {"white_dn", noisy.white_dn}});
        frames.back().update(gain_json(noisy.gain));
        progress->advance(1);
      }
    }
  };
  const auto print = [&] {
    if (frames.empty()) return;
    if (const std::string complaint = source.coverage->complaint(); !complaint.empty())
      warn(complaint);
    const bool other_black = arguments.settings.amplify || arguments.settings.debias;
    print_result(common,
                 {{"model", arguments.model.string()},
                  {"sensor", source.sensor},
                  {"seed", common.seed},
                  {"settings", settings_json(arguments.settings)},
                  {"frames", frames}},
                 frames_text(frames, other_black && !arguments.as_float));
  };
  work_and_print(work, print);
}

}  // namespace

void add_synthesize(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<SynthesizeArguments>();
  CLI::App* command = add_command(
      app, common, "synthesize", "Noisy frames from clean ones, as a calibrated camera takes them",
      {.seed = true, .force = true}, [arguments, &common] { run_synthesize(*arguments, common); });
  command
      ->add_option("CLEAN", arguments->inputs,
                   "clean mosaics: float in DN above black, or integers with --black")
      ->required();
  command
      ->add_option("-m,--model", arguments->model,
                   "noise model: a file or a built-in name; or a trained Noise Flow (.safetensors)")
      ->required();
  command->add_option("-o,--output", arguments->folder, "folder of the results")->required();
  auto* gain = command->add_option("--gain", arguments->gain,
                                   "camera gain [dB], or random: uniform in log K over the "
                                   "calibrated range (gaussian and nonparametric: uniform in dB "
                                   "between their calibrated gains; dark-frames: one of the gains "
                                   "that have dark frames), anew for every frame");
  command->add_option("--iso", arguments->iso, "camera gain as ISO")
      ->check(positive_number())
      ->excludes(gain);
  command->add_option("--frames", arguments->frames, "noisy frames per clean one")
      ->check(in_range(1, 1000000))
      ->capture_default_str();
  command
      ->add_option("--first-frame", arguments->first_frame,
                   "number of the first frame drawn; frames count on over the inputs, and seed and "
                   "number decide the noise")
      ->check(frame_number())
      ->capture_default_str();
  add_origin(*command, arguments->origin,
             "row,column on the sensor of the first pixel, where CLEAN is a crop");
  command->add_flag("--float", arguments->as_float,
                    "write DN above black, unrounded, instead of the camera's integers");
  command->add_option("--format", arguments->format, "ending of the results")
      ->check(one_of(noisy_formats()))
      ->capture_default_str();
  arguments->raw.add_to(*command, {.gain = false, .means = false});
  add_flags(*command, arguments->settings);
  arguments->kind = command->get_option("--kind");
}

}  // namespace malus::app
