// malus experiment renoise: noise on noise (001, S6) where the truth is known. Clean mosaics get
// the noise of one gain; every way of making frames of a noisier gain from them is compared with
// frames that the camera would have taken there: 001 Table S1 without the network.
#include "malus/base/error.h"
#include "malus/denoise/denoiser.h"
#include "malus/evaluate/noise_comparison.h"
#include "malus/io/frame_file.h"
#include "malus/noise/model.h"
#include "malus/synthesize/compiled.h"
#include "malus/synthesize/equivalent_models.h"
#include "malus/synthesize/model.h"
#include "malus/synthesize/pairs.h"
#include "malus/synthesize/renoise.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <numeric>
#include <vector>

#include "denoise_method.h"
#include "experiments.h"
#include "flags.h"
#include "frame_input.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct RenoiseExperimentArguments {
  RawOptions raw;
  fs::path clean;
  std::string model = "imx250myr-simulated", weak_guide = "plane-bm3d";
  double from = 12, to = 18;
  int frames = 8;
};

// The mean physics of both gains; what the camera rounds is not drawn.
struct Gains {
  NoiseModel model;
  GainSetting from_gain;
  PhysicsNoise from, to;
};

Gains gains_of(const RenoiseExperimentArguments& arguments) {
  const Model door = Model::load(arguments.model);
  Gains gains{door.description(), door.gain_setting(arguments.from), {}, {}};
  const GainSetting to_gain = door.gain_setting(arguments.to);
  warn_of_untold_gain(gains.model, arguments.model, {gains.from_gain, to_gain});
  gains.from = gains.model.physics_at(gains.from_gain);
  gains.to = gains.model.physics_at(to_gain);
  gains.to.parts.quantization = false;
  return gains;
}

// Rounded and clipped as the camera does, DN above black.
Image camera_frame(const Gains& gains, Image dn) {
  const NoiseModel& model = gains.model;
  round_as_camera(dn, model.layout, {model.black_dn, model.white_dn, model.quantization_dn});
  RawFrame frame;
  frame.dn = std::move(dn);
  frame.layout = model.layout;
  frame.black_dn = model.black_dn;
  frame.white_dn = model.white_dn;
  subtract_black(frame);
  return std::move(frame.dn);
}

Image noisy_frame(const Gains& gains, const PhysicsNoise& noise, const Image& clean_dn,
                  const DrawAddress& address) {
  PhysicsNoise drawn = noise;
  drawn.parts.quantization = false;
  Image dn(clean_dn.rows(), clean_dn.cols());
  CompiledNoise(drawn).apply(clean_dn, dn, address);
  return camera_frame(gains, std::move(dn));
}

Image denoised(const Gains& gains, const Image& noisy_dn, const std::string& method) {
  RawFrame frame;
  frame.dn = noisy_dn;
  frame.layout = gains.model.layout;
  frame.black_dn.assign(gains.model.black_dn.size(), 0.0);
  frame.white_dn = white_above_black(gains.model.white_dn, gains.model.black_dn);
  frame.gain = gains.from_gain;
  frame.black_known = frame.white_known = frame.layout_known = true;
  DenoiseSettings settings;
  settings.method = method;
  return denoise_frame(std::move(frame), gains.model.profile_at(gains.from_gain), settings)
      .dn_above_black;
}

// One row of the table: how frame number i is made from its noisy source.
struct Variant {
  std::string name;
  std::function<Image(const Image& noisy_dn, const DrawAddress& address)> make;
};

std::vector<Variant> variants_of(const RenoiseExperimentArguments& arguments, const Gains& gains,
                                 const Image& clean_dn) {
  const auto renoiser = std::make_shared<Renoiser>(
      gains.from, gains.to, white_above_black(gains.model.white_dn, gains.model.black_dn));
  const auto on_noisy = [renoiser](const Image& noisy_dn, const Image& guide_dn,
                                   const DrawAddress& address) {
    Image dn(noisy_dn.rows(), noisy_dn.cols());
    renoiser->apply(noisy_dn, guide_dn, dn, address);
    return dn;
  };
  const auto difference =
      std::make_shared<CompiledNoise>(gaussian_difference(gains.from, gains.to));
  const std::string weak = arguments.weak_guide;
  return {
      {"noise on noise, true signal",
       [=, &clean_dn](const Image& noisy_dn, const DrawAddress& address) {
         return on_noisy(noisy_dn, clean_dn, address);
       }},
      {"noise on noise, bm3d",
       [=, &gains](const Image& noisy_dn, const DrawAddress& address) {
         return on_noisy(noisy_dn, denoised(gains, noisy_dn, "bm3d"), address);
       }},
      {"noise on noise, " + weak,
       [=, &gains](const Image& noisy_dn, const DrawAddress& address) {
         return on_noisy(noisy_dn, denoised(gains, noisy_dn, weak), address);
       }},
      {"Gaussian on noise, bm3d",
       [difference, &gains](const Image& noisy_dn, const DrawAddress& address) {
         return gaussian_on_noise(*difference, noisy_dn, denoised(gains, noisy_dn, "bm3d"),
                                  address);
       }},
      {"naive: bm3d + new noise",
       [&gains](const Image& noisy_dn, const DrawAddress& address) {
         Image dn = denoised(gains, noisy_dn, "bm3d");
         CompiledNoise(gains.to).apply(dn.view(), dn.view(), second_noise(address));
         return dn;
       }},
  };
}

// Per channel.
std::vector<double> biases_of(const PhysicsNoise& noise) {
  std::vector<double> bias_dn;
  for (const PhysicsChannel& channel : noise.channels) bias_dn.push_back(channel.mu_dn);
  return bias_dn;
}

Json score_of(const std::string& name, const Gains& gains, const Image& clean_dn,
              const std::vector<Image>& truth, const std::vector<Image>& frames) {
  const auto set_of = [](const std::vector<Image>& set) {
    return NoiseFrames{static_cast<int>(set.size()),
                       [&set](int i) { return set[static_cast<std::size_t>(i)]; }};
  };
  const NoiseComparison c =
      compare_noise(set_of(truth), set_of(frames), clean_dn, gains.model.layout, {});
  const auto mean_of = [](const std::vector<double>& values) {
    return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
  };
  FrameMean mean;
  for (const Image& frame : frames) mean.add(frame);
  const auto detail =
      kept_detail_psnr_db(mean.mean(), clean_dn, gains.model.layout, biases_of(gains.to),
                          white_above_black(gains.model.white_dn, gains.model.black_dn));
  return {{"name", name},
          {"sqrt_jsd", c.pooled.sqrt_jsd},
          {"sqrt_jsd_floor", c.pooled.sqrt_jsd_floor},
          {"sd_dn", mean_of(c.test.sd_dn)},
          {"detail_psnr_db", detail.value_or(std::nan(""))}};
}

// DN above black, no highlights: where frames clip there is no noise to compare.
RawFrame load_clean_light(const RenoiseExperimentArguments& arguments, const NoiseModel& model) {
  RawFrame clean = load_frame(
      arguments.clean, options_in_layout(arguments.raw.resolve(), model.layout, arguments.clean));
  if (clean.holds_codes() && !clean.black_known)
    throw InputError(arguments.clean.string(), "holds integers, but its black level is not known",
                     "give --black (0 where black is subtracted already)");
  check_finite(clean.dn, arguments.clean.string(), "taken as dark");
  subtract_black(clean);
  const auto top = static_cast<float>(0.8 * white_above_black(model.white_dn, model.black_dn));
  for (float& v : clean.dn.values()) v = std::isfinite(v) ? std::clamp(v, 0.0f, top) : 0.0f;
  return clean;
}

void run_renoise_experiment(const RenoiseExperimentArguments& arguments, const Common& common) {
  const Gains gains = gains_of(arguments);
  const RawFrame clean = load_clean_light(arguments, gains.model);
  const auto variants = variants_of(arguments, gains, clean.dn);
  const auto progress = make_progress(common);
  progress->begin("experiment", std::ssize(variants) * arguments.frames);
  // Frames of the target gain: one set to compare with, and another that shows how near it can get.
  std::vector<Image> truth, again, sources;
  const auto address_of = [&](int set, int i) {
    return DrawAddress{.seed = common.seed,
                       .frame = static_cast<std::uint32_t>(set * arguments.frames + i)};
  };
  for (int i = 0; i < arguments.frames; ++i) {
    sources.push_back(noisy_frame(gains, gains.from, clean.dn, address_of(0, i)));
    truth.push_back(noisy_frame(gains, gains.to, clean.dn, address_of(1, i)));
    again.push_back(noisy_frame(gains, gains.to, clean.dn, address_of(2, i)));
  }
  Json rows = Json::array();
  rows.push_back(score_of("frames of the target gain", gains, clean.dn, truth, again));
  for (const Variant& variant : variants) {
    std::vector<Image> made;
    for (int i = 0; i < arguments.frames; ++i) {
      check_stop(*progress);
      made.push_back(camera_frame(
          gains, variant.make(sources[static_cast<std::size_t>(i)], address_of(0, i))));
      progress->advance(1);
    }
    rows.push_back(score_of(variant.name, gains, clean.dn, truth, made));
  }
  std::string table =
      "| frames | √JSD | its floor | noise sd [DN] | kept detail [dB] |\n"
      "|---|---|---|---|---|\n";
  for (const Json& row : rows)
    table +=
        fmt::format("| {} | {:.4f} | {:.4f} | {:.2f} | {:.2f} |\n", row["name"].get<std::string>(),
                    row["sqrt_jsd"].get<double>(), row["sqrt_jsd_floor"].get<double>(),
                    row["sd_dn"].get<double>(), row["detail_psnr_db"].get<double>());
  print_result(common,
               {{"model", arguments.model},
                {"from", arguments.from},
                {"to", arguments.to},
                {"frames", arguments.frames},
                {"variants", rows}},
               table);
}

}  // namespace

void add_renoise_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<RenoiseExperimentArguments>();
  CLI::App* command =
      add_command(experiment, common, "renoise",
                  "Ways to make frames of a noisier gain, where the truth is known", {.seed = true},
                  [arguments, &common] { run_renoise_experiment(*arguments, common); });
  command
      ->add_option("CLEAN", arguments->clean,
                   "clean mosaic in DN above black; cut at 80 % of the range")
      ->required();
  command->add_option("--model", arguments->model, "noise model, a file or a built-in name")
      ->capture_default_str();
  command->add_option("--from", arguments->from, "gain of the source frames, in the model's unit")
      ->check(finite_number())
      ->capture_default_str();
  command->add_option("--to", arguments->to, "gain to imitate")
      ->check(finite_number())
      ->capture_default_str();
  command->add_option("--frames", arguments->frames, "frames of each kind")
      ->check(in_range(2, 10000))
      ->capture_default_str();
  command->add_option("--weak-guide", arguments->weak_guide, "a denoising method to compare with")
      ->check(accepted_by(require_method))
      ->capture_default_str();
  arguments->raw.add_to(*command, {.gain = false, .means = false});
}

}  // namespace malus::app
