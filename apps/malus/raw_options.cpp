#include "raw_options.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/image/black_levels.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <set>
#include <tuple>

#include "flags.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {

namespace {

// The black level of dark frames, and the gain that they tell by themselves.
void take_black_of_dark(const std::vector<std::filesystem::path>& files, FrameOptions& options) {
  FrameOptions of_dark = options;
  of_dark.black_dn.clear();
  of_dark.gain = {};
  DarkLevels levels;
  for (const std::filesystem::path& file : frames_of_inputs(files, of_dark)) {
    const RawFrame dark = load_frame(file, of_dark);
    if (!dark.layout_known)
      warn_of(dark.source,
              "does not tell its layout: all channels get one black level; give --layout");
    if (const std::string cut_off = cut_off_note(dark); !cut_off.empty())
      warn_of(dark.source, cut_off + ": its mean lies above the black level");
    levels.add(dark);
  }
  options.black_dn = levels.black_dn();
  options.black_gain = levels.gain();
}

void require_counted(const char* flag, double dn) {
  if (!(std::abs(dn) <= kMostCountedDn))
    throw CLI::ValidationError(
        flag, fmt::format("{:g} DN is beyond all that cameras count; correct it", dn));
}

void add_layout(CLI::App& command, std::string& layout, bool polarized, const std::string& group) {
  std::vector<std::string> names = SensorLayout::known_names();
  if (polarized)
    std::erase_if(names,
                  [](const std::string& name) { return !SensorLayout::named(name).polarized(); });
  command.add_option("--layout", layout, fmt::format("sensor layout: {}", joined(names)))
      ->check(accepted_by([polarized, names](const std::string& name) {
        if (!SensorLayout::named(name).polarized() && polarized)
          throw InputError(name, "has no four polarizer angles", "choose one of " + joined(names));
      }))
      ->group(group);
}

}  // namespace

void RawOptions::add_to(CLI::App& command, With with) {
  const std::string group = "Raw input (each wins over the file and the session)";
  add_layout(command, layout_, with.polarized, group);
  auto* black = command
                    .add_option("--black", black_dn_,
                                "black level: one number, or one per channel, separated by commas "
                                "[DN]")
                    ->delimiter(',')
                    ->allow_extra_args(false)
                    ->check(finite_number())
                    ->group(group);
  if (with.dark)
    command
        .add_option("--dark", dark_,
                    "frames with the lens cap on, at the same gain: the mean of each channel is "
                    "the black level")
        ->excludes(black)
        ->group(group);
  command.add_option("--white", white_dn_, "saturation, black level included [DN]")
      ->check(positive_number())
      ->group(group);
  if (with.gain) {
    auto* gain = command.add_option("--gain", gain_db_, "camera gain [dB]")
                     ->check(gain_in_db())
                     ->group(group);
    command.add_option("--iso", iso_, "camera gain as ISO")
        ->check(positive_number())
        ->excludes(gain)
        ->group(group);
  }
  command.add_option("--exposure", exposure_s_, "exposure time [s]")
      ->check(positive_number())
      ->group(group);
  if (with.means)
    command
        .add_option("--mean-of", mean_of_,
                    "every RAW is the mean of as many frames of a scene that stood still, black "
                    "level included")
        ->check(in_range(1, kMostAveraged))
        ->group(group);
  command
      .add_option("--raw-format", raw_format_,
                  fmt::format("headerless input: {}", joined(raw_format_names())))
      ->check(accepted_by([](const std::string& name) { raw_format_named(name); }))
      ->group(group);
  command.add_option("--size", size_, "WIDTHxHEIGHT; required for headerless input")
      ->check(accepted_by([](const std::string& size) { parse_frame_size(size); }))
      ->group(group);
  command.add_option("--session", session_, "session file whose [sensor] describes the frames")
      ->group(group);
}

// Flags that contradict each other, whatever the frames are.
void RawOptions::check_usage() const {
  as_usage([&] {
    if (!layout_.empty() && !black_dn_.empty())
      black_per_channel(black_dn_, SensorLayout::named(layout_), "--black");
  });
  for (const double dn : black_dn_) require_counted("--black", dn);
  if (white_dn_) require_counted("--white", *white_dn_);
  if (white_dn_ && std::ranges::any_of(black_dn_, [&](double dn) { return dn >= *white_dn_; }))
    throw CLI::ValidationError(
        "--black", fmt::format("{:g} DN is not below --white {:g} DN; correct one of them",
                               *std::ranges::max_element(black_dn_), *white_dn_));
  if (!raw_format_.empty() && size_.empty() && session_.empty())
    throw CLI::ValidationError("--raw-format",
                               "a headerless file needs its size; give --size (width and height)");
}

FrameOptions RawOptions::resolve() const {
  check_usage();
  FrameOptions options;
  if (!layout_.empty()) options.layout = SensorLayout::named(layout_);
  options.black_dn = black_dn_;
  options.white_dn = white_dn_;
  options.gain = {gain_db_, iso_};
  options.exposure_s = exposure_s_;
  options.mean_of = mean_of_;
  if (!raw_format_.empty()) options.raw_format = raw_format_named(raw_format_);
  if (!size_.empty()) std::tie(options.rows, options.cols) = parse_frame_size(size_);
  if (!session_.empty())
    options = merged(
        options,
        frame_options({.sensor = load_sensor(session_), .groups = {}, .source = {}}, FrameGroup()));
  if (!dark_.empty()) take_black_of_dark(dark_, options);
  return options;
}

std::vector<std::filesystem::path> RawOptions::files_read() const {
  std::vector<std::filesystem::path> files = dark_;
  files.push_back(session_);
  return files;
}

std::vector<std::filesystem::path> frames_of_inputs(
    const std::vector<std::filesystem::path>& inputs, const FrameOptions& options) {
  std::vector<std::filesystem::path> frames;
  std::error_code unknown;
  for (const std::filesystem::path& input : inputs) {
    const bool is_there = std::filesystem::exists(frame_place(input).file, unknown);
    const auto own = frame_names(input, options.raw_format.has_value() || !is_there);
    frames.insert(frames.end(), own.begin(), own.end());
  }
  return frames;
}

FrameOptions headerless_part(const FrameOptions& options) {
  FrameOptions part;
  part.raw_format = options.raw_format;
  part.rows = options.rows;
  part.cols = options.cols;
  return part;
}

void require_headers(const std::vector<std::filesystem::path>& frames,
                     const FrameOptions& options) {
  for (const std::filesystem::path& frame : frames) probe_frame(frame, headerless_part(options));
}

std::string stem_of(const std::filesystem::path& input) {
  const FramePlace place = frame_place(input);
  const std::string stem = place.file.stem().string();
  return place.index ? fmt::format("{}_{:03}", stem, *place.index) : stem;
}

std::vector<std::filesystem::path> output_names(
    const std::vector<std::filesystem::path>& inputs, const std::filesystem::path& folder,
    const std::string& suffix, const std::vector<std::filesystem::path>& read_besides) {
  std::vector<std::filesystem::path> names;
  std::set<std::filesystem::path> read;
  // A stream (/dev/stdin) leads to no path; its reader says what is wrong with it.
  std::error_code no_path;
  for (const auto& list : {inputs, read_besides})
    for (const auto& path : list)
      if (!path.empty())
        read.insert(std::filesystem::weakly_canonical(frame_place(path).file, no_path));
  std::map<std::filesystem::path, std::filesystem::path> writer;
  for (const auto& input : inputs) {
    const auto name = folder / (stem_of(input) + suffix);
    if (const auto [other, fresh] = writer.emplace(name, input); !fresh)
      throw InputError(input.string(),
                       fmt::format("its output {} would replace that of {}", name.string(),
                                   other->second.string()),
                       "rename one of them or run them apart");
    if (read.contains(std::filesystem::weakly_canonical(name)))
      throw InputError(name.string(), "is an input and would be replaced by a result",
                       "choose another output folder, or leave earlier results out of the inputs");
    names.push_back(name);
  }
  return names;
}

}  // namespace malus::app
