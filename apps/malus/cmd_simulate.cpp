// malus simulate: clean raw mosaics from pictures, with or without polarization (001, S4).
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/picture_file.h"
#include "malus/synthesize/light_scale.h"
#include "malus/synthesize/scene.h"

#include <array>
#include <filesystem>
#include <iterator>
#include <memory>
#include <vector>

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

struct SimulateArguments {
  std::vector<fs::path> inputs;
  fs::path folder;
  std::string layout = "polar-bayer-rggb", format = "tif", tone = "auto";
  CameraResponse response;
  SceneSettings scene;
  std::uint32_t first_scene = 0;
  bool polarized = false, truth = false;
};

// Linear red, green, blue (or one plane) in [0, 1] and above, cropped to whole cells.
Planes load_linear(const fs::path& path, const SimulateArguments& arguments,
                   const SensorLayout& layout) {
  const Picture picture = load_clean_picture(path);
  const Planes light = checked_light(picture, path.string(), is_srgb(arguments.tone, picture.bits));
  const std::string complaint =
      picture_scale_complaint(light, picture.bits, arguments.response.exposure);
  if (!complaint.empty()) warn_of(path.string(), complaint);
  return whole_cells(light, layout, path.string());
}

constexpr const char *kS0 = "_s0.exr", *kS1 = "_s1.exr", *kS2 = "_s2.exr", *kDolp = "_dolp.exr",
                     *kAolp = "_aolp.exr", *kNormals = "_normals.exr";

constexpr std::array<const char*, 6> kTruth = {kS0, kS1, kS2, kDolp, kAolp, kNormals};

std::vector<std::string> mosaic_formats() { return {"tif", "npy", "fits", "exr"}; }

bool writes(const SimulateArguments& arguments, const char* suffix) {
  return arguments.truth && (suffix != kNormals || arguments.polarized);
}

// As the mosaics before the work: none may exist already or be a picture that is read.
void check_truth_files(const SimulateArguments& arguments, bool force) {
  for (const char* suffix : kTruth)
    if (writes(arguments, suffix))
      for (const fs::path& name : output_names(arguments.inputs, arguments.folder, suffix))
        check_output(name, force);
}

// What goes as a mosaic is written: the same in another format, and of the scene that it shows no
// more the truth that is not written again.
std::vector<fs::path> stale_files(const SimulateArguments& arguments, const fs::path& input,
                                  const fs::path& mosaic, bool force) {
  std::vector<fs::path> stale =
      left_in_other_formats(mosaic, mosaic_formats(), arguments.inputs, force);
  const bool replaces = !stale.empty() || fs::exists(mosaic);
  std::vector<fs::path> truth;
  for (const char* suffix : kTruth)
    if (replaces && !writes(arguments, suffix))
      truth.push_back(arguments.folder / (stem_of(input) + suffix));
  truth = existing_apart(truth, arguments.inputs);
  stale.insert(stale.end(), truth.begin(), truth.end());
  return stale;
}

void write_truth(const SimulateArguments& arguments, const std::string& stem,
                 const PolarScene& scene, bool force) {
  SaveOptions save;
  save.force = force;
  save.type = SampleType::kFloat;
  const std::vector<std::string> names = scene.stokes.size() == 1
                                             ? std::vector<std::string>{"Y"}
                                             : std::vector<std::string>{"R", "G", "B"};
  const auto write = [&](const char* suffix, auto&& image_of) {
    Planes planes(static_cast<int>(scene.stokes.size()), 0, 0);
    for (std::size_t k = 0; k < scene.stokes.size(); ++k)
      planes[static_cast<int>(k)] = image_of(scene.stokes[k]);
    save_picture(arguments.folder / (stem + suffix), planes, names, save);
  };
  write(kS0, [](const StokesPlanes& s) { return s.s0; });
  write(kS1, [](const StokesPlanes& s) { return s.s1; });
  write(kS2, [](const StokesPlanes& s) { return s.s2; });
  write(kDolp, [](const StokesPlanes& s) { return dolp_of(s); });
  write(kAolp, [](const StokesPlanes& s) { return aolp_deg_of(s); });
  if (scene.normal_x.empty()) return;
  Planes normals(3, 0, 0);
  normals[0] = scene.normal_x;
  normals[1] = scene.normal_y;
  normals[2] = scene.normal_z;
  save_picture(arguments.folder / (stem + kNormals), normals, {"X", "Y", "Z"}, save);
}

std::vector<PlannedFile> plan_mosaics(const SimulateArguments& arguments,
                                      const std::vector<fs::path>& names, bool force) {
  for (const fs::path& name : names) check_output(name, force);
  check_truth_files(arguments, force);
  std::vector<PlannedFile> plans;
  for (std::size_t i = 0; i < names.size(); ++i)
    plans.push_back({names[i], stale_files(arguments, arguments.inputs[i], names[i], force)});
  return plans;
}

void check_usage(const SimulateArguments& arguments) {
  as_usage([&] {
    require_numbers_left("--first-scene", arguments.first_scene, std::ssize(arguments.inputs));
    require_usable(arguments.response);
  });
}

void run_simulate(const SimulateArguments& arguments, const Common& common) {
  check_usage(arguments);
  const SensorLayout layout = SensorLayout::named(arguments.layout);
  const auto names = output_names(arguments.inputs, arguments.folder, "_clean." + arguments.format);
  const OutputFolder output(arguments.folder);
  const std::vector<PlannedFile> plans = plan_mosaics(arguments, names, common.force);
  const auto progress = make_progress(common);
  progress->begin("simulate", static_cast<std::int64_t>(plans.size()));
  SaveOptions save;
  save.force = common.force;
  save.type = SampleType::kFloat;
  Json frames = Json::array();
  std::string text;
  const auto work = [&] {
    for (std::size_t i = 0; i < plans.size(); ++i) {
      check_stop(*progress);
      const Planes camera =
          camera_rgb_of(load_linear(arguments.inputs[i], arguments, layout), arguments.response);
      const std::uint32_t number = arguments.first_scene + static_cast<std::uint32_t>(i);
      PolarScene scene;
      if (arguments.polarized)
        scene = polarized_scene(camera, arguments.scene, common.seed, number);
      else
        scene.stokes = unpolarized(camera);
      RawFrame frame;
      frame.dn = mosaic_of(scene.stokes, layout);
      frame.layout = layout;
      frame.black_dn.assign(static_cast<std::size_t>(layout.channels()), 0.0);
      frame.white_dn = arguments.response.white_dn;
      frame.black_known = frame.white_known = frame.layout_known = true;
      for (const fs::path& path : plans[i].stale) fs::remove(path);
      save_frame(plans[i].name, frame, save);
      if (arguments.truth)
        write_truth(arguments, stem_of(arguments.inputs[i]), scene, common.force);
      frames.push_back({{"input", arguments.inputs[i].string()},
                        {"output", plans[i].name.string()},
                        {"scene", number},
                        {"rows", frame.dn.rows()},
                        {"cols", frame.dn.cols()}});
      text += fmt::format("{} <- {}: {} x {} {}\n", plans[i].name.string(),
                          arguments.inputs[i].string(), frame.dn.cols(), frame.dn.rows(),
                          layout.name());
      progress->advance(1);
    }
  };
  const auto print = [&] {
    if (frames.empty()) return;
    print_result(common,
                 {{"layout", layout.name()},
                  {"polarized", arguments.polarized},
                  {"seed", common.seed},
                  {"response", settings_json(arguments.response)},
                  {"scene", settings_json(arguments.scene)},
                  {"frames", frames}},
                 text);
  };
  work_and_print(work, print);
}

}  // namespace

void add_simulate(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<SimulateArguments>();
  CLI::App* command = add_command(
      app, common, "simulate", "Clean raw mosaics from pictures, polarized if wanted",
      {.seed = true, .force = true}, [arguments, &common] { run_simulate(*arguments, common); });
  command->add_option("PICTURE", arguments->inputs, "EXR (linear) or PNG, TIFF, JPEG (sRGB)")
      ->required();
  command->add_option("-o,--output", arguments->folder, "folder of the results")->required();
  command->add_option("--layout", arguments->layout, "sensor layout")
      ->check(one_of(SensorLayout::known_names()))
      ->capture_default_str();
  CLI::Option* polarized = command->add_flag(
      "--polarized", arguments->polarized,
      "give the scene a relief and polarize its light by the Fresnel equations; seed "
      "and number decide the relief");
  command->add_flag("--truth", arguments->truth,
                    "also S0, S1, S2, DoLP, AoLP at full resolution and the normals, as EXR");
  command
      ->add_option("--tone", arguments->tone,
                   "tone curve of the pictures: auto = sRGB for "
                   "integers, none for float")
      ->check(one_of(picture_tones()))
      ->capture_default_str();
  command->add_option("--first-scene", arguments->first_scene, "number of the first scene")
      ->check(frame_number())
      ->capture_default_str();
  command->add_option("--format", arguments->format, "ending of the mosaics")
      ->check(one_of(mosaic_formats()))
      ->capture_default_str();
  add_flags(*command, arguments->response);
  command->get_option("--color-matrix")->expected(9)->allow_extra_args(false);
  command->get_option("--white-balance")->expected(3)->allow_extra_args(false);
  add_flags(*command, arguments->scene);
  SceneSettings::describe(arguments->scene, [&](const auto&, const ParameterInfo& info) {
    command->get_option(flag_name(info.name))->needs(polarized);
  });
}

}  // namespace malus::app
