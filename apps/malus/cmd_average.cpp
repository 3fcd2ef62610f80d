// malus average: frames of a scene that stood still to their mean, which denoise, stokes and
// normals take as one frame of less noise.
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/image/frame_mean.h"
#include "malus/io/picture_file.h"

#include <filesystem>
#include <memory>
#include <set>
#include <vector>

#include "flags.h"
#include "frame_contents.h"
#include "frame_input.h"
#include "output_check.h"
#include "program.h"
#include "raw_options.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

constexpr double kMostChanged = 0.002;  // of the picture: more is no chance

struct AverageArguments {
  RawOptions raw;
  std::vector<fs::path> inputs;
  fs::path output;
};

RawFrame load_raw(const fs::path& input, const FrameOptions& options) {
  FrameInfo info = load_frame_info(input, options);
  require_raw(input.string(), info.holds, "give the raw frames");
  return std::move(info.frame);
}

void check_written_facts(const RawFrame& frame, const fs::path& output) {
  for (const std::string& complaint : mean_complaints(frame)) warn_of(frame.source, complaint);
  if (lower_case(output.extension().string()) == ".npy")
    warn_of(output.string(),
            fmt::format("keeps pixels alone: with it --mean-of {} goes, and layout, levels and "
                        "gain (.tif, .fits and .exr keep them)",
                        frame.mean_of));
}

Json average(const AverageArguments& arguments, const FrameOptions& options, Progress& progress,
             bool force) {
  const auto count = static_cast<int>(arguments.inputs.size());
  progress.begin("average", count);
  SceneMean frames(count);
  for (const fs::path& input : arguments.inputs) {
    check_stop(progress);
    const RawFrame frame = load_raw(input, options);
    if (const std::string cut_off = cut_off_of_mean_note(frame); !cut_off.empty())
      warn_of(frame.source, cut_off);
    frames.add(frame);
    progress.advance(1);
  }
  const double changed = frames.changed_share();
  const RawFrame mean = frames.take();
  if (changed > kMostChanged)
    warn(
        fmt::format("{}: {} % of the picture differ between the first and the last frames by more "
                    "than noise: did scene or camera move?",
                    arguments.output.string(), percent_text(changed)));
  check_written_facts(mean, arguments.output);
  SaveOptions save;
  save.force = force;
  save.type = SampleType::kFloat;
  save_frame(arguments.output, mean, save);
  return {{"frames", count},
          {"rows", mean.dn.rows()},
          {"cols", mean.dn.cols()},
          {"layout", mean.layout.name()},
          {"gain", mean.gain.text()},
          {"changed_share", changed},
          {"file", arguments.output.string()}};
}

// A frame twice has the same noise twice.
void refuse_again(const std::vector<fs::path>& inputs) {
  std::set<fs::path> known;
  for (const fs::path& input : inputs)
    if (!known.insert(frame_identity(input)).second)
      throw InputError(input.string(), "is given twice", "leave it out once");
}

void run_average(AverageArguments arguments, const Common& common) {
  as_usage([&] { require_ending_for(arguments.output, SampleType::kFloat); });
  const FrameOptions options = arguments.raw.resolve();
  arguments.inputs = frames_of_inputs(arguments.inputs, options);
  if (arguments.inputs.size() < 2)
    throw InputError(arguments.inputs.front().string(), "is one frame",
                     "give two or more of one scene, or a stack of them");
  if (arguments.inputs.size() > kMostAveraged)
    throw InputError(arguments.inputs.back().string(),
                     fmt::format("is frame {} of them", arguments.inputs.size()),
                     fmt::format("give {} or less", kMostAveraged));
  refuse_again(arguments.inputs);
  require_headers(arguments.inputs, options);
  std::vector<fs::path> read;
  for (const fs::path& input : arguments.inputs) read.push_back(frame_place(input).file);
  check_output_apart("-o", arguments.output, read, {}, common.force);
  const auto progress = make_progress(common);
  const Json json = average(arguments, options, *progress, common.force);
  print_result(common, json,
               fmt::format("{}: mean of {}, {} x {} {}\n", arguments.output.string(),
                           counted(json["frames"].get<int>(), "frame"), json["cols"].get<int>(),
                           json["rows"].get<int>(), json["layout"].get<std::string>()));
}

}  // namespace

void add_average(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<AverageArguments>();
  CLI::App* command =
      add_command(app, common, "average", "The mean of raw frames of a scene that stood still",
                  {.force = true}, [arguments, &common] { run_average(*arguments, common); });
  command->add_option("RAW", arguments->inputs, "mosaics of one scene, taken alike")->required();
  command
      ->add_option("-o,--output", arguments->output,
                   "the mean in DN, black level included (.tif, .fits, .exr or .npy); it says how "
                   "many frames it is of")
      ->required();
  arguments->raw.add_to(*command, {.means = false});
}

}  // namespace malus::app
