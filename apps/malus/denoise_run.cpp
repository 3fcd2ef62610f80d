#include "denoise_run.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/evaluate/evaluation.h"
#include "malus/image/finite_pixels.h"
#include "malus/image/pack.h"
#include "malus/io/frame_file.h"
#include "malus/io/gain_json.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "frame_input.h"
#include "program.h"
#include "stokes_uncertainty.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

// Folders without links and "..", so that a way from one to the other exists as it is spelled.
std::string relative_to(const fs::path& path, const fs::path& folder) {
  const fs::path whole = fs::absolute(path),
                 place = fs::weakly_canonical(whole.parent_path()) / whole.filename();
  const fs::path relative = place.lexically_relative(fs::weakly_canonical(fs::absolute(folder)));
  return relative.empty() ? place.string() : relative.string();
}

[[noreturn]] void refuse_record(const fs::path& file, const std::string& problem) {
  throw InputError(file.string(), "is not a record of a denoise run: " + problem,
                   "denoise the frame again");
}

// Pixels are floats: what none of them can hold is no DN, and turning it into one is not defined.
double pixel_number(const Json& json, const char* name, const fs::path& file) {
  const double value = json.get<double>();
  if (!(std::abs(value) <= std::numeric_limits<float>::max()))
    refuse_record(file, fmt::format("{} is {:g}", name, value));
  return value;
}

double number_in(const Json& json, const char* key, const fs::path& file) {
  return pixel_number(json.at(key), key, file);
}

// Read as a double, in which any number of JSON is itself or near: get<int> would take a part of
// it.
int count_in(const Json& json, const char* key, const fs::path& file) {
  constexpr int kMostPixels = 1 << 20;  // of a side
  const double value = json.at(key).get<double>();
  if (!(value >= 1 && value <= kMostPixels && value == std::floor(value)))
    refuse_record(
        file, fmt::format("{} is {:g}, not a whole number from 1 to {}", key, value, kMostPixels));
  return static_cast<int>(value);
}

SensorLayout layout_of_record(const Json& record, const fs::path& file) {
  try {
    return SensorLayout::from_sites(
        record.at("sites").get<std::vector<std::vector<std::string>>>());
  } catch (const InputError& error) {
    refuse_record(file, "sites: " + error.problem());
  }
}

NoiseProfile profile_of_record(const Json& record, const SensorLayout& layout,
                               const fs::path& file) {
  NoiseProfile profile;
  profile.layout = layout;
  if (record.contains("row_group")) profile.row_group = count_in(record, "row_group", file);
  profile.estimated_from_picture = record.value("noise_estimated_from_picture", false);
  for (const Json& line : record.at("noise_line"))
    profile.channels.push_back(
        {.variance = VarianceCurve::fitted_line(std::max(number_in(line, "slope_dn", file), 0.0),
                                                number_in(line, "offset_dn2", file), 0.0),
         .gain_dn_per_e = number_in(line, "gain_dn_per_e", file)});
  if (static_cast<int>(profile.channels.size()) != layout.channels())
    refuse_record(file, "noise_line does not fit the layout");
  return profile;
}

std::vector<Quantity> metrics_of(const DenoisedFrame& frame, const Image& test) {
  return quantities_of(
      evaluate_mosaics(frame.reference_dn, test, frame.before.layout, frame.reference_peak_dn));
}

// Of a run with --uncertainty, whose file may have been taken away since.
void take_variance(const fs::path& path, DenoisedFrame& frame) {
  std::error_code unknown;
  if (!fs::exists(path, unknown)) return;
  frame.variance_dn2 = Image(frame.before.dn.rows(), frame.before.dn.cols());
  unpack(load_variance(path, frame.before), frame.before.layout, frame.variance_dn2);
}

}  // namespace

Json run_record(const RawFrame& before, const NoiseProfile& profile, const fs::path& input,
                std::optional<RawFormat> raw_format, const fs::path& result, Json run) {
  const fs::path folder = result.parent_path();
  Json record = {{"kind", "denoise"},
                 {"input_file", relative_to(input, folder)},
                 {"result_file", relative_to(result, folder)},
                 {"sites", Json::array()},
                 {"black_dn", before.black_dn},
                 {"white_dn", before.white_dn},
                 {"row_group", profile.row_group},
                 {"noise_estimated_from_picture", profile.estimated_from_picture},
                 {"noise_line", Json::array()}};
  if (raw_format) {  // such a file does not tell its size either, which the run does
    record["raw_format"] = raw_format_name(*raw_format);
    record["rows"] = run.at("rows");
    record["cols"] = run.at("cols");
  }
  record.update(gain_json(before.gain));
  for (int row = 0; row < before.layout.rows(); ++row) {
    Json names = Json::array();
    for (int col = 0; col < before.layout.cols(); ++col)
      names.push_back(before.layout.channel_name(before.layout.channel_at(row, col)));
    record["sites"].push_back(names);
  }
  for (std::size_t c = 0; c < profile.channels.size(); ++c) {
    const ChannelProfile& channel = profile.channels[c];
    const double dark = channel.variance(0), reach = before.white_dn - before.black_dn[c];
    record["noise_line"].push_back({{"slope_dn", (channel.variance(reach) - dark) / reach},
                                    {"offset_dn2", dark},
                                    {"gain_dn_per_e", channel.gain_dn_per_e}});
  }
  record["run"] = std::move(run);
  return record;
}

void add_reference(DenoisedFrame& frame, const Reference& reference, bool black_stated) {
  const RawFrame& before = frame.before;
  const fs::path& path = reference.path;
  FrameOptions options;
  const RawFrame known = probe_frame(path, options).frame;
  if (known.layout_known && !(known.layout == before.layout))
    throw InputError(
        path.string(),
        fmt::format("has the layout {}, the frame {}", known.layout.name(), before.layout.name()),
        "give the same scene's clean mosaic");
  options.layout = before.layout;
  FloatBlack float_black = FloatBlack::kAboveAlready;
  if (!known.black_known && reference.black_dn) {
    options.black_dn = {*reference.black_dn};
    float_black = FloatBlack::kHolds;
  } else if (!known.black_known) {
    options.black_dn = before.black_dn;
    const double black = mean_of(before.black_dn);
    const bool of_another_kind = !before.holds_codes();  // above black, as floats are
    if (known.holds_codes() && (black != 0 || of_another_kind) && !black_stated)
      warn(
          fmt::format("{}: black level not known, taken as the frame's, {:g} DN; give its own by "
                      "--reference-black (0 where black is subtracted already)",
                      path.string(), black));
  }
  RawFrame clean = load_above_black(path, options, float_black);
  if (clean.dn.rows() != before.dn.rows() || clean.dn.cols() != before.dn.cols())
    throw InputError(path.string(),
                     fmt::format("has {} x {} pixels, the frame {} x {}", clean.dn.cols(),
                                 clean.dn.rows(), before.dn.cols(), before.dn.rows()),
                     "give the same scene's clean mosaic");
  require_whole_cell(clean.dn, clean.layout, path.string());
  if (!known.holds_codes() && !known.black_known && !reference.black_dn)
    warn_of_held_black(path, finite_mean(clean.dn.view()),
                       reference.ratio * (finite_mean(before.dn.view()) - mean_of(before.black_dn)),
                       mean_of(before.black_dn), "give --reference-black");
  for (float& value : clean.dn.values()) value = static_cast<float>(value / reference.ratio);
  frame.reference_dn = std::move(clean.dn);
  frame.reference_peak_dn = white_above_black(before.white_dn, before.black_dn) / reference.ratio;
}

fs::path check_inputs(const std::vector<fs::path>& frames, const std::vector<fs::path>& references,
                      const FrameOptions& options, bool by_model) {
  fs::path untold;
  for (const fs::path& path : frames) {
    const FrameInfo info = probe_frame(path, headerless_part(options));
    if (by_model) require_raw(path.string(), info.holds, "give the raw frame");
    if (!info.frame.layout_known && !options.layout && untold.empty()) untold = path;
  }
  for (const fs::path& path : references) probe_frame(path);
  return untold;
}

void measure_before(DenoisedFrame& frame) {
  frame.metrics_before = metrics_of(frame, above_black(frame.before));
}

void measure_after(DenoisedFrame& frame) {
  frame.metrics_after = metrics_of(frame, frame.after_dn);
}

Json metrics_json(const DenoisedFrame& frame) {
  const auto values = [](const std::vector<Quantity>& metrics) {
    Json json;
    for (const Quantity& quantity : metrics) json[quantity.name] = quantity.value.front();
    return json;
  };
  return {{"before", values(frame.metrics_before)}, {"after", values(frame.metrics_after)}};
}

std::string metrics_text(const DenoisedFrame& frame) {
  std::string text;
  for (const Quantity& after : frame.metrics_after) {
    const auto before = std::ranges::find(frame.metrics_before, after.name, &Quantity::name);
    text += fmt::format("  {:<14} {:8.3f} -> {:8.3f}\n", after.name,
                        before == frame.metrics_before.end() ? std::nan("") : before->value.front(),
                        after.value.front());
  }
  return text;
}

void name_reference(Json& record, const Reference& reference, const fs::path& result) {
  record["reference_file"] = relative_to(reference.path, result.parent_path());
  record["reference_ratio"] = reference.ratio;
  if (reference.black_dn) record["reference_black_dn"] = *reference.black_dn;
}

void name_variance(Json& record, const fs::path& variance, const fs::path& result) {
  record["variance_file"] = relative_to(variance, result.parent_path());
}

DenoisedFrame load_run(const fs::path& record_file, const Json& record) {
  try {
    const fs::path folder = record_file.parent_path();
    FrameOptions options;
    options.layout = layout_of_record(record, record_file);
    for (const Json& black : record.at("black_dn"))
      options.black_dn.push_back(pixel_number(black, "black_dn", record_file));
    options.white_dn = number_in(record, "white_dn", record_file);
    options.gain = checked_gain_from(record, record_file.string());
    if (record.contains("raw_format")) {
      options.raw_format = raw_format_named(record.at("raw_format").get<std::string>());
      options.rows = count_in(record, "rows", record_file);
      options.cols = count_in(record, "cols", record_file);
    }
    DenoisedFrame frame;
    frame.before = load_frame(folder / record.at("input_file").get<std::string>(), options);
    FrameOptions plain;
    plain.layout = options.layout;
    plain.rows = frame.before.dn.rows();
    plain.cols = frame.before.dn.cols();
    frame.after_dn = load_frame(folder / record.at("result_file").get<std::string>(), plain).dn;
    frame.profile = profile_of_record(record, *options.layout, record_file);
    frame.run = record.at("run");
    if (!frame.run.is_object()) refuse_record(record_file, "run is no object");
    if (record.contains("variance_file"))
      take_variance(folder / record.at("variance_file").get<std::string>(), frame);
    if (record.contains("reference_file")) {
      Reference reference{folder / record.at("reference_file").get<std::string>(),
                          number_in(record, "reference_ratio", record_file),
                          {}};
      if (record.contains("reference_black_dn"))
        reference.black_dn = number_in(record, "reference_black_dn", record_file);
      if (!(reference.ratio > 0)) refuse_record(record_file, "reference_ratio is not above 0");
      add_reference(frame, reference, true);
      measure_before(frame);
      measure_after(frame);
    }
    return frame;
  } catch (const Json::exception& error) {
    refuse_record(record_file, error.what());
  }
}

}  // namespace malus::app
