// malus dataset: many synthetic pairs as tar shards, by any number of workers.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/fingerprint.h"
#include "malus/base/parallel.h"
#include "malus/base/text.h"
#include "malus/base/unfinished_files.h"
#include "malus/base/worker_place.h"
#include "malus/image/pack.h"
#include "malus/io/config_section.h"
#include "malus/io/frame_file.h"
#include "malus/io/gain_json.h"
#include "malus/io/shard.h"
#include "malus/noise/model.h"
#include "malus/synthesize/dataset.h"
#include "malus/synthesize/light_scale.h"

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <map>
#include <memory>
#include <mutex>
#include <utility>

#include "dataset_camera.h"
#include "dataset_folder.h"
#include "flags.h"
#include "frame_input.h"
#include "networks_door.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct DatasetArguments {
  fs::path config, folder;
  std::optional<int> rank, world;
};

// What the configuration file says.
struct Plan {
  std::string model;  ///< as it is written there
  fs::path model_path;
  DatasetSettings dataset;
  SynthesisSettings noise;
  std::vector<fs::path> cleans;
  std::vector<double> black_dn;
  std::optional<ConfigSection> root;     ///< for messages
  std::optional<ConfigSection> section;  ///< [dataset], or the root where there is none
};

void check_noise(const ConfigSection& section, const fs::path& model) {
  if (section.has("ratio"))
    section.fail("ratio", "has no meaning here", "list ratios in [dataset]");
  // The usual kind, too, which the settings do not tell from none.
  if (section.has("kind") && names_noise_flow(model))
    section.fail("kind", "means nothing to the noise of a Noise Flow", "leave it out");
}

Plan load_plan(const fs::path& path) {
  const ConfigSection root = ConfigSection::load(path, "the data-set configuration");
  root.require_known({"model", "clean", "black", "dataset", "noise"});
  Plan plan;
  plan.root = root;
  plan.noise.debias = plan.noise.amplify = true;
  if (!root.has("model")) root.fail("model", "is missing", "name a noise model");
  plan.model = *root.text("model");
  plan.model_path = plan.model;
  // A file beside the configuration goes before a built-in name.
  if (const fs::path beside = path.parent_path() / plan.model_path; fs::exists(beside))
    plan.model_path = beside;
  for (const std::string& pattern : root.texts("clean")) {
    const auto found = files_matching(path.parent_path(), pattern);
    if (found.empty())
      root.fail("clean", fmt::format("\"{}\" matches no file", pattern), "check the pattern");
    for (const fs::path& file : found) {
      const auto frames = frame_names(file);
      plan.cleans.insert(plan.cleans.end(), frames.begin(), frames.end());
    }
  }
  if (plan.cleans.empty()) root.fail("clean", "is missing", "name clean mosaics in DN above black");
  plan.black_dn = root.numbers("black");
  for (const double black : plan.black_dn)
    if (!std::isfinite(black)) root.fail("black", "is no finite number", "give it in DN");
  plan.section = root;
  if (const auto section = root.section("dataset")) {
    section->read(plan.dataset);
    plan.section = section;
  }
  if (const auto section = root.section("noise")) section->read(plan.noise, {"ratio"});
  if (const auto section = root.section("noise")) check_noise(*section, plan.model_path);
  return plan;
}

// Which part is ours: flags, else what torchrun, mpirun or srun set.
WorkerPlace worker_of(const DatasetArguments& arguments) {
  const WorkerPlace place = arguments.rank && arguments.world
                                ? WorkerPlace{*arguments.rank, *arguments.world}
                                : worker_place_of_environment();
  require_place(place, "count workers from 0 to their number - 1 (--rank, --world)");
  return place;
}

// Clean mosaics above black, loaded when first needed and kept while they fit.
class CleanSources {
 public:
  CleanSources(const Plan& plan, const NoiseModel& model)
      : plan_(plan), white_dn_(white_of_light_dn(model)) {
    FrameOptions declared;
    declared.black_dn = plan.black_dn;
    for (const fs::path& path : plan.cleans) {
      options_.push_back(options_in_layout(declared, model.layout, path));
      const FrameInfo info = probe_frame(path, options_.back());
      if (info.frame.holds_codes() && !info.frame.black_known)
        throw InputError(path.string(), "holds integers, but its black level is not known",
                         "give black in the configuration (0 where black is subtracted already)");
      require_room(path.string(), info.rows, info.cols, plan.dataset, model.layout);
      sizes_.emplace_back(info.rows, info.cols);
    }
  }
  const std::vector<std::pair<int, int>>& sizes() const { return sizes_; }
  std::shared_ptr<const Image> get(std::size_t index) {
    const std::lock_guard lock(mutex_);
    if (const auto found = held_.find(index); found != held_.end()) return found->second;
    RawFrame frame = load_frame(plan_.cleans[index], options_[index]);
    if (frame.holds_codes()) subtract_black(frame);  // float files hold DN above black already
    require_finite(frame.dn, plan_.cleans[index].string());
    if (const std::string line = light_scale_complaint(frame.dn, white_dn_);
        !line.empty() && !std::exchange(scale_said_, true))
      warn_of(plan_.cleans[index].string(), line);
    if (held_pixels_ > kMostPixels) {
      held_.clear();
      held_pixels_ = 0;
    }
    held_pixels_ += frame.dn.size();
    return held_[index] = std::make_shared<const Image>(std::move(frame.dn));
  }

 private:
  static constexpr std::size_t kMostPixels = std::size_t{1} << 28;  // 1 GiB
  const Plan& plan_;
  double white_dn_;  // above black; 0: not known
  bool scale_said_ = false;
  std::vector<FrameOptions> options_;  // of each clean
  std::vector<std::pair<int, int>> sizes_;
  std::mutex mutex_;
  std::map<std::size_t, std::shared_ptr<const Image>> held_;
  std::size_t held_pixels_ = 0;
};

struct Factory {
  const Plan& plan;
  const std::unique_ptr<DatasetCamera> camera;
  CleanSources sources;
  std::uint64_t seed;
  std::string set;  ///< named in every sample
  std::mutex coverage_mutex;
  LevelCoverage coverage;  ///< of all samples made

  Factory(const Plan& p, std::uint64_t s)
      : plan(p),
        camera(p.root->naming(
            "model", [&] { return open_dataset_camera(p.model_path, p.dataset, p.noise); })),
        sources(p, camera->camera()),
        seed(s) {
    camera->prepare();
  }

  // The files of one sample: clean, noisy, facts.
  std::array<std::pair<std::string, std::string>, 3> make(std::uint32_t number) {
    const NoiseModel& description = camera->camera();
    const SampleRecipe recipe = sample_recipe(plan.dataset, description.layout,
                                              description.row_group, sources.sizes(), seed, number);
    const TrainingPair pair = camera->pair(recipe, *sources.get(recipe.source), seed);
    {
      const std::lock_guard lock(coverage_mutex);
      coverage.add(pair.coverage);
    }
    Json facts{{kSetKey, set},
               {"source", plan.cleans[recipe.source].filename().string()},
               {"row", recipe.row0},
               {"col", recipe.col0},
               {"symmetry", std::string(facts_of(recipe.symmetry).name)},
               {"ratio", recipe.ratio},
               {"removed_bias_dn", pair.removed_bias_dn}};
    facts.update(gain_json(pair.gain));
    const std::string name = fmt::format("{:09}", number);
    return {{{name + ".clean.npy", npy_bytes(pack(pair.clean_dn, description.layout))},
             {name + ".noisy.npy", npy_bytes(pack(pair.noisy_dn, description.layout))},
             {name + ".json", json_utf8(facts, -1)}}};
  }
};

// Of the files that the frames are in.
std::map<fs::path, std::string> fingerprints_of(const std::vector<fs::path>& frames) {
  std::vector<fs::path> files;
  for (const fs::path& frame : frames) files.push_back(frame_place(frame).file);
  std::sort(files.begin(), files.end());
  files.erase(std::unique(files.begin(), files.end()), files.end());
  std::vector<std::string> prints(files.size());
  parallel_for(0, std::ssize(files), 1, [&](std::ptrdiff_t from, std::ptrdiff_t to) {
    for (auto i = static_cast<std::size_t>(from); i < static_cast<std::size_t>(to); ++i)
      prints[i] = file_fingerprint(files[i]);
  });
  std::map<fs::path, std::string> by_file;
  for (std::size_t i = 0; i < files.size(); ++i) by_file.emplace(files[i], prints[i]);
  return by_file;
}

// Everything that the pixels follow from. Files are named without their folders, which may be moved
// between two runs, and told apart by their content: a picture that was made anew under its name
// usually has the same size, and copies have other times. Each is read once more for that, which is
// what one or two samples of it cost.
Json dataset_json(const Plan& plan, const Factory& factory) {
  const std::map<fs::path, std::string> prints = fingerprints_of(plan.cleans);
  const NoiseModel& description = factory.camera->camera();
  Json json{{"model", plan.model},
            {"model_fingerprint",  // none: built in
             fs::exists(plan.model_path) ? Json(file_fingerprint(plan.model_path)) : Json()},
            {"sensor", description.sensor},
            {"layout", description.layout.name()},
            {"channels", description.layout.channel_names()},
            {"unit", "DN above black"},
            {"seed", factory.seed},
            {"black", plan.black_dn},
            {"dataset", settings_json(plan.dataset)},
            {"noise", factory.camera->noise_json()},
            {"clean", Json::array()}};
  for (const fs::path& clean : plan.cleans)
    json["clean"].push_back(
        {{"file", clean.filename().string()}, {"fingerprint", prints.at(frame_place(clean).file)}});
  return json;
}

void write_shard(Factory& factory, const fs::path& path, int shard, bool force,
                 const Progress& progress) {
  constexpr int kAtOnce = 32;  // samples in memory
  const DatasetSettings& settings = factory.plan.dataset;
  const int first = shard * settings.shard_size;
  const int count = std::min(settings.shard_size, settings.samples - first);
  TarShard tar(path, force);
  for (int begin = 0; begin < count; begin += kAtOnce) {
    check_stop(progress);
    const int end = std::min(begin + kAtOnce, count);
    std::vector<std::array<std::pair<std::string, std::string>, 3>> samples(
        static_cast<std::size_t>(end - begin));
    parallel_for(begin, end, 1, [&](std::ptrdiff_t from, std::ptrdiff_t to) {
      for (std::ptrdiff_t i = from; i < to; ++i)
        samples[static_cast<std::size_t>(i - begin)] =
            factory.make(static_cast<std::uint32_t>(first + i));
    });
    for (const auto& sample : samples)
      for (const auto& [name, content] : sample) tar.add(name, content);
  }
  tar.commit();
}

// Settings that no sample could be made with fail here, not after hours: the patch, and one cell
// with every gain.
void try_settings(const Factory& factory) {
  const Plan& plan = factory.plan;
  const NoiseModel& description = factory.camera->camera();
  try {
    require_patch_of_cells(plan.dataset, description.layout, description.row_group);
  } catch (const InputError& error) {
    plan.section->fail("patch", fmt::format("= {} {}", plan.dataset.patch, error.problem()),
                       error.remedy());
  }
  plan.section->naming("gains", [&] { factory.camera->try_gains(); });
}

// The factory of a folder that is ready for its shards.
std::unique_ptr<Factory> open_dataset(const Plan& plan, const fs::path& folder,
                                      const Common& common) {
  auto factory = std::make_unique<Factory>(plan, common.seed);
  try_settings(*factory);
  for (const std::string& line : factory->camera->cautions()) warn(line);
  const Json json = dataset_json(plan, *factory);
  factory->set = set_name(json);
  const OutputFolder output(folder);
  // Of runs that were killed; workers that share the folder go on with theirs.
  remove_unfinished(folder, [](std::string_view name) {
    return name == "dataset.json" || (name.starts_with("shard-") && name.ends_with(".tar"));
  });
  prepare_dataset_folder(folder, json, common.force);
  return factory;
}

void run_dataset(const DatasetArguments& arguments, const Common& common) {
  const Plan plan = load_plan(arguments.config);
  const auto [rank, world] = worker_of(arguments);
  const auto factory = open_dataset(plan, arguments.folder, common);
  const int shards = (plan.dataset.samples + plan.dataset.shard_size - 1) / plan.dataset.shard_size;
  const auto progress = make_progress(common);
  progress->begin("data set", (shards - rank + world - 1) / world);
  int made = 0, kept = 0;
  for (int shard = rank; shard < shards; shard += world) {
    check_stop(*progress);
    const fs::path path = arguments.folder / fmt::format("shard-{:06}.tar", shard);
    if (!common.force && shard_is_made(path, factory->set)) {
      ++kept;
    } else {
      write_shard(*factory, path, shard, common.force, *progress);
      ++made;
    }
    progress->advance(1);
  }
  if (const std::string complaint = factory->coverage.complaint(); !complaint.empty())
    warn(complaint);
  print_result(common,
               {{"folder", arguments.folder.string()},
                {"rank", rank},
                {"world", world},
                {"shards", shards},
                {"made", made},
                {"kept", kept}},
               fmt::format("{}: {} made, {} already there, {} in all\n", arguments.folder.string(),
                           counted(made, "shard"), kept, shards));
}

}  // namespace

void add_dataset(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<DatasetArguments>();
  CLI::App* command = add_command(app, common, "dataset", "Synthetic training pairs as tar shards",
                                  {.seed = true, .force = true},
                                  [arguments, &common] { run_dataset(*arguments, common); });
  command->add_option("CONFIG", arguments->config, "data-set configuration (TOML)")->required();
  command->add_option("-o,--output", arguments->folder, "folder of the shards; finished ones stay")
      ->required();
  CLI::Option* rank =
      command
          ->add_option("--rank", arguments->rank,
                       "number of this worker, from 0; otherwise from torchrun, mpirun or srun")
          ->check(in_range(0, kMostWorkers));
  CLI::Option* world = command->add_option("--world", arguments->world, "number of workers")
                           ->check(in_range(1, kMostWorkers))
                           ->needs(rank);
  rank->needs(world);
}

}  // namespace malus::app
