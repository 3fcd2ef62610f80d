#include "evaluate_noise.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/image/pack.h"
#include "malus/noise/model.h"
#include "malus/noise/same_sensor.h"
#include "malus/synthesize/synthesizer.h"

#include <cmath>
#include <functional>
#include <memory>

#include "frame_input.h"
#include "networks_door.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

NoiseFrames frames_of(const std::vector<fs::path>& paths, const FrameOptions& options) {
  return {static_cast<int>(paths.size()), [paths, options](int k) {
            return load_above_black(paths[static_cast<std::size_t>(k)], options).dn;
          }};
}

// What stands in place of a camera: frames in DN above black, rounded and clipped as the camera's
// are, or not.
struct StandIn {
  SensorLayout layout;
  std::function<Image(const Image& clean, const GainSetting& gain, const DrawAddress& address,
                      bool rounded)>
      draw;
};

StandIn calibrated_stand_in(const NoiseArguments& arguments) {
  SynthesisSettings settings;
  settings.kind = arguments.kind.value_or(settings.kind);
  const auto synthesizer =
      std::make_shared<const Synthesizer>(load_model(arguments.model), settings);
  return {synthesizer->model().layout,
          [=](const Image& clean, const GainSetting& gain, const DrawAddress& address,
              bool rounded) -> Image {
            if (!rounded) return synthesizer->draw(clean, gain, address).dn;
            const NoiseModel& model = synthesizer->model();
            RawFrame frame = synthesizer->draw_raw(clean, gain, address, model.black_dn,
                                                   model.white_dn > 0 ? model.white_dn : 65535.0);
            subtract_black(frame);
            return std::move(frame.dn);
          }};
}

StandIn flow_stand_in(const NoiseArguments& arguments) {
  if (arguments.kind)
    throw InputError("--kind " + *arguments.kind, "means nothing to a Noise Flow", "leave it out");
  const std::shared_ptr<FlowSampler> flow = networks().open_flow(arguments.model);
  return {SensorLayout::named(flow->sensor().layout),
          [=](const Image& clean, const GainSetting& gain, const DrawAddress& address,
              bool rounded) -> Image {
            if (!rounded) return flow->draw(clean.view(), gain, address);
            RawFrame frame = flow->draw_raw(clean.view(), gain, address);
            subtract_black(frame);
            return std::move(frame.dn);
          }};
}

StandIn stand_in_for(const NoiseArguments& arguments, const RawFrame& reference) {
  StandIn stand_in = arguments.model.extension() == ".safetensors" ? flow_stand_in(arguments)
                                                                   : calibrated_stand_in(arguments);
  if (reference.layout_known) require_layout_of_model(reference, stand_in.layout);
  return stand_in;
}

Moments moments_over(const Image& image) {
  Moments moments;
  for (const float v : image.values())
    if (std::isfinite(v)) moments.add(static_cast<double>(v));
  return moments;
}

// The uniform scene that the reference shows: its channels' means less those of a frame drawn
// without light. Below a twentieth of the noise a channel counts as dark.
Image uniform_scene(const StandIn& stand_in, const RawFrame& reference, const DrawAddress& address,
                    bool rounded) {
  constexpr double kDark = 0.05;
  Image scene(reference.dn.rows(), reference.dn.cols());
  const Planes lit = pack(reference.dn, stand_in.layout),
               dark = pack(stand_in.draw(scene, reference.gain, address, rounded), stand_in.layout);
  std::vector<float> light_dn;
  for (int k = 0; k < lit.channels(); ++k) {
    const Moments found = moments_over(lit[k]), unlit = moments_over(dark[k]);
    const double light = found.mean() - unlit.mean();
    light_dn.push_back(light > kDark * std::sqrt(unlit.variance()) ? static_cast<float>(light)
                                                                   : 0.0f);
  }
  for (int r = 0; r < scene.rows(); ++r)
    for (int c = 0; c < scene.cols(); ++c)
      scene(r, c) = light_dn[static_cast<std::size_t>(stand_in.layout.channel_at(r, c))];
  return scene;
}

// Numbers of drawn frames begin here: the reference may be what synthesize drew of the same seed,
// and noise must not be compared with itself.
constexpr std::uint32_t kFirstFrame = 1u << 31;

// Rounded and clipped when the reference's are whole numbers.
NoiseFrames frames_drawn(const StandIn& stand_in, const NoiseArguments& arguments,
                         const Common& common, const RawFrame& reference,
                         const std::optional<Image>& clean) {
  const int count =
      arguments.frames > 0 ? arguments.frames : static_cast<int>(arguments.reference.size());
  const bool rounded = reference.bits > 0;
  const auto address = [seed = common.seed](int frame) {
    return DrawAddress{seed, kFirstFrame + static_cast<std::uint32_t>(frame), 0, 0};
  };
  const Image scene = clean ? *clean : uniform_scene(stand_in, reference, address(count), rounded);
  return {count, [draw = stand_in.draw, scene, address, gain = reference.gain, rounded](int k) {
            return draw(scene, gain, address(k), rounded);
          }};
}

Json distance_json(const NoiseDistance& d) {
  return {{"signal_dn", d.signal_dn},
          {"bin_width_dn", d.bin_width_dn},
          {"reference_samples", d.reference_samples},
          {"test_samples", d.test_samples},
          {"kld", d.kld_nats},
          {"jsd", d.jsd_bits},
          {"sqrt_jsd", d.sqrt_jsd},
          {"sqrt_jsd_floor", d.sqrt_jsd_floor}};
}

Json structure_json(const NoiseStructure& s) {
  return {{"mean_dn", s.mean_dn},
          {"sd_dn", s.sd_dn},
          {"sigma_row_dn", s.row_sd_dn},
          {"sigma_column_dn", s.column_sd_dn},
          {"row_power_dn2", s.row_power_dn2},
          {"correlation_along_row", s.along_row},
          {"correlation_along_column", s.along_column}};
}

Json comparison_json(const NoiseComparison& c, const NoiseComparisonSettings& settings,
                     const SensorLayout& layout) {
  Json json;
  json["definitions"] = {{"kld", "D(test||reference), nats"},
                         {"jsd", "base 2, 0 to 1"},
                         {"bins", settings.bins},
                         {"bin_range", "6 standard deviations on both sides of the mean"}};
  json["pooled"] = distance_json(c.pooled);
  json["levels"] = Json::array();
  for (const auto& level : c.levels) json["levels"].push_back(distance_json(level));
  json["levels_left_out"] = c.levels_left_out;
  json["channels"] = layout.channel_names();
  json["reference"] = structure_json(c.reference);
  json["test"] = structure_json(c.test);
  return json;
}

std::string distance_line(const std::string& name, const NoiseDistance& d) {
  return fmt::format("  {:>12}  {:>10.4g}  {:>9.5f}  {:>9.5f}  {:>9.5f}  {:>9.5f}  {:>10}\n", name,
                     d.bin_width_dn, d.kld_nats, d.jsd_bits, d.sqrt_jsd, d.sqrt_jsd_floor,
                     d.test_samples);
}

std::string comparison_text(const NoiseComparison& c, int bins) {
  std::string text = fmt::format(
      "KLD is D(test||reference) in nats, JSD has base 2; {} bins over 6 sd on both sides\n"
      "  {:>12}  {:>10}  {:>9}  {:>9}  {:>9}  {:>9}  {:>10}\n",
      bins, "signal DN", "bin DN", "KLD", "JSD", "root JSD", "its floor", "samples");
  for (const auto& level : c.levels)
    text += distance_line(fmt::format("{:.2f}", level.signal_dn), level);
  text += distance_line("pooled", c.pooled);
  if (c.levels_left_out > 0)
    text += fmt::format("  {} levels left out: fewer than {} samples\n", c.levels_left_out,
                        kEnoughSamples);
  text += fmt::format("{:<34}{:>12}{:>12}\n", "mean over the channels", "reference", "test");
  const auto row = [&](const char* name, const std::vector<double>& a,
                       const std::vector<double>& b) {
    text += fmt::format("  {:<32}{:>12.4f}{:>12.4f}\n", name, mean_of(a), mean_of(b));
  };
  row("mean [DN]", c.reference.mean_dn, c.test.mean_dn);
  row("standard deviation [DN]", c.reference.sd_dn, c.test.sd_dn);
  row("row noise [DN]", c.reference.row_sd_dn, c.test.row_sd_dn);
  row("column noise [DN]", c.reference.column_sd_dn, c.test.column_sd_dn);
  const auto &one = c.reference.row_power_dn2, &two = c.test.row_power_dn2;
  for (std::size_t band = 0; band < std::min(one.size(), two.size()); ++band)
    text += fmt::format("  {:<32}{:>12.4f}{:>12.4f}\n",
                        fmt::format("row power, band {} of {} [DN²]", band + 1, kRowBands),
                        one[band], two[band]);
  for (std::size_t i = 0; i < static_cast<std::size_t>(kLags); ++i) {
    text += fmt::format("  {:<32}{:>12.4f}{:>12.4f}\n",
                        fmt::format("correlation, {} along the row", i + 1),
                        c.reference.along_row[i], c.test.along_row[i]);
    text += fmt::format("  {:<32}{:>12.4f}{:>12.4f}\n",
                        fmt::format("correlation, {} along the column", i + 1),
                        c.reference.along_column[i], c.test.along_column[i]);
  }
  return text;
}

}  // namespace

void run_noise_comparison(const NoiseArguments& arguments, const RawOptions& raw,
                          const Common& common) {
  const FrameOptions options = raw.resolve();
  const RawFrame first = load_above_black(arguments.reference.front(), options);
  std::optional<Image> clean;
  if (!arguments.clean.empty()) clean = load_above_black(arguments.clean, options).dn;
  SensorLayout layout = first.layout;
  NoiseFrames test;
  if (!arguments.model.empty()) {
    const StandIn stand_in = stand_in_for(arguments, first);
    layout = stand_in.layout;
    test = frames_drawn(stand_in, arguments, common, first, clean);
  } else {
    test = frames_of(arguments.test, options);
  }
  const auto progress = make_progress(common);
  const NoiseComparison comparison = compare_noise(frames_of(arguments.reference, options), test,
                                                   clean, layout, arguments.settings, *progress);
  print_result(common, comparison_json(comparison, arguments.settings, layout),
               comparison_text(comparison, arguments.settings.bins));
}

}  // namespace malus::app
