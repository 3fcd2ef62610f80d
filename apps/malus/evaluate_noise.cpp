#include "evaluate_noise.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/evaluate/noise_cautions.h"
#include "malus/image/frame_mean.h"
#include "malus/image/pack.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <set>

#include "frame_input.h"
#include "noise_stand_in.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr const char* kLeftOut = "left out";  // pixels that are no numbers

// Pixels that are left out of a set's frames, each of which is loaded several times.
struct LeftOut {
  std::size_t all;  ///< frames
  std::set<int> seen;
  std::vector<std::string> frames;
  std::int64_t pixels = 0;

  void take(int k, const Image& dn, const std::string& frame) {
    if (!seen.insert(k).second) return;
    if (const std::int64_t odd = nonfinite_pixels(dn, frame); odd > 0) {
      frames.push_back(frame);
      pixels += odd;
    }
    if (seen.size() == all && !frames.empty()) say();
  }
  void say() const {
    const std::string others =
        frames.size() > 1 ? " and " + counted(std::ssize(frames) - 1, "more frame") : "";
    warn(fmt::format("{}{}: {} NaN or infinite; {}", frames.front(), others,
                     counted_are(pixels, "pixel"), kLeftOut));
  }
};

// They are said in one line, once every frame was loaded.
NoiseFrames frames_of(const std::vector<fs::path>& paths, const FrameOptions& options) {
  const auto left_out = std::make_shared<LeftOut>(LeftOut{paths.size(), {}, {}});
  return {static_cast<int>(paths.size()), [paths, options, left_out](int k) {
            const fs::path& path = paths[static_cast<std::size_t>(k)];
            RawFrame frame = load_above_black(path, options);
            require_whole_cell(frame.dn, frame.layout, path.string());
            left_out->take(k, frame.dn, path.string());
            return std::move(frame.dn);
          }};
}

// Noise compared with itself is the same, and a frame that counts twice, or is the clean one,
// makes two samples of one.
void require_each_once(const NoiseArguments& arguments) {
  std::map<fs::path, std::string> seen;  // by frame, links followed
  const auto take = [&](const fs::path& path, const char* what) {
    const auto [first, is_new] = seen.emplace(frame_identity(path), what);
    if (!is_new)
      throw InputError(path.string(),
                       fmt::format("is given twice, as {} and as {}: its noise would be compared "
                                   "with itself",
                                   first->second, what),
                       "name every file once");
  };
  for (const fs::path& path : arguments.reference) take(path, "a frame of --reference");
  for (const fs::path& path : arguments.test) take(path, "a frame of --test");
  if (!arguments.clean.empty()) take(arguments.clean, "--clean");
}

// What is drawn has one gain, so the frames that it is compared with have one; sets of frames tell
// for themselves, but the noise of several gains together is no camera's.
void check_one_gain(const std::vector<fs::path>& paths, const FrameOptions& options, bool drawn) {
  const fs::path* first = nullptr;  // that states one
  GainSetting gain;
  for (const fs::path& path : paths) {
    const GainSetting own = probe_frame(path, options).frame.gain;
    if (!first && own.decibel()) {
      first = &path;
      gain = own;
    }
    if (!own.contradicts(gain)) continue;
    const std::string problem =
        fmt::format("was taken at {}, {} at {}", own.text(), first->string(), gain.text());
    if (drawn)
      throw InputError(path.string(), problem, "compare the frames of each gain by themselves");
    warn_of(path.string(), problem + ": their noise is compared as if it were of one gain");
  }
}

// Not by chance: two samples of one distribution differ by the floor.
void warn_of_copies(const NoiseComparison& comparison, const NoiseArguments& arguments) {
  if (arguments.test.empty() || comparison.pooled.jsd_bits > 0) return;
  warn(fmt::format(
      "{}: its frames' noise has the very histogram of the reference's: are they copies of {}?",
      arguments.test.front().string(), arguments.reference.front().string()));
}

StandIn stand_in_for(const NoiseArguments& arguments) {
  if (!names_noise_flow(arguments.model)) {
    SynthesisSettings settings;
    settings.kind = arguments.kind.value_or(settings.kind);
    return calibrated_stand_in(std::make_shared<const NoiseModel>(load_model(arguments.model)),
                               arguments.model, settings);
  }
  if (arguments.kind)
    throw InputError("--kind " + *arguments.kind, "means nothing to a Noise Flow", "leave it out");
  return flow_stand_in(arguments.model);
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
          {"correlation_along_column", s.along_column},
          {"correlation_between_frames", s.between_frames}};
}

Json comparison_json(const NoiseComparison& c, const NoiseComparisonSettings& settings,
                     const SensorLayout& layout) {
  Json json;
  json["definitions"] = {{"kld", "D(test||reference), nats"},
                         {"jsd", "base 2, 0 to 1"},
                         {"bins", settings.bins},
                         {"bin_range", "6 standard deviations on both sides of the mean"}};
  json["rounded_to_steps_dn"] = {{"reference", c.reference_rounded_dn},
                                 {"test", c.test_rounded_dn}};
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
    text += fmt::format("  {} left out: fewer than {} samples\n",
                        counted(c.levels_left_out, "level"), kEnoughSamples);
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
  row("correlation, frame to frame", {c.reference.between_frames}, {c.test.between_frames});
  return text;
}

// Of noise that is small beside the step, rounding leaves little to compare.
void tell_of_rounding(const NoiseComparison& c, const Common& common) {
  constexpr double kFewSteps = 0.5;
  const auto tell = [&](const char* side, const char* other, double step_dn, double sd_dn) {
    if (step_dn == 0) return;
    const std::string told = fmt::format(
        "the {} are not in steps of {:g} DN, as the codes of the {} are: for the divergences they "
        "were rounded to these",
        side, step_dn, other);
    if (sd_dn < kFewSteps * step_dn)
      warn(
          fmt::format("{}, which hide much of a noise of {:.2g} DN; the divergences are of what "
                      "is left",
                      told, sd_dn));
    else
      note(common, told);
  };
  tell("reference's frames", "tests", c.reference_rounded_dn, mean_of(c.reference.sd_dn));
  tell("tests' frames", "reference", c.test_rounded_dn, mean_of(c.test.sd_dn));
}

}  // namespace

void run_noise_comparison(const NoiseArguments& given, const RawOptions& raw,
                          const Common& common) {
  FrameOptions options = raw.resolve();
  NoiseArguments arguments = given;
  arguments.reference = frames_of_inputs(given.reference, options);
  arguments.test = frames_of_inputs(given.test, options);
  require_each_once(arguments);
  std::optional<StandIn> stand_in;
  if (!arguments.model.empty()) {
    stand_in = stand_in_for(arguments);
    options = options_for_model(options, stand_in->levels, arguments.reference.front());
  }
  for (const auto* paths : {&arguments.reference, &arguments.test})
    check_one_gain(*paths, options, stand_in.has_value());
  const RawFrame first = load_above_black(arguments.reference.front(), options);
  if (stand_in) {
    for (const fs::path& path : arguments.reference)  // frames are drawn one by one
      require_single(probe_frame(path, options).frame);
    stand_in->warn_of_gain(first.gain);
  }
  std::optional<Image> clean;
  if (!arguments.clean.empty()) {
    clean = load_above_black(arguments.clean, options).dn;
    check_finite(*clean, arguments.clean.string(), kLeftOut);
  }
  const int count =
      arguments.frames > 0 ? arguments.frames : static_cast<int>(arguments.reference.size());
  const NoiseFrames reference = frames_of(arguments.reference, options),
                    test = stand_in ? frames_drawn(*stand_in, reference, first, clean, count,
                                                   common.seed)
                                    : frames_of(arguments.test, options);
  const SensorLayout& layout = stand_in ? stand_in->levels.layout : first.layout;
  const auto progress = make_progress(common);
  const NoiseComparison comparison =
      compare_noise(reference, test, clean, layout, arguments.settings, *progress);
  warn_of_copies(comparison, arguments);
  for (const std::string& line : cautions_of(comparison, arguments.settings)) warn(line);
  tell_of_rounding(comparison, common);
  print_result(common, comparison_json(comparison, arguments.settings, layout),
               comparison_text(comparison, arguments.settings.bins));
}

}  // namespace malus::app
