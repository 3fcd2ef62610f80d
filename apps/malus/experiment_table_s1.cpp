// malus experiment table-s1: 001 Table S1. Frames of one gain are made to look like a noisier gain
// in several ways; a neural ISP is trained on each and scored on captures of the noisier gain, and
// the noise that was made is compared with the camera's.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/denoise/frame_profile.h"
#include "malus/io/config_section.h"
#include "malus/io/picture_file.h"
#include "malus/synthesize/model.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <memory>

#include "captures.h"
#include "denoiser_by_ratio.h"
#include "experiments.h"
#include "frame_input.h"
#include "networks_door.h"
#include "output_check.h"
#include "report_pages.h"
#include "table_s1_frames.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct TableS1Arguments {
  fs::path rows, folder, report, pairs, test_pairs;
  std::vector<fs::path> pictures, test_pictures;
  int crop = 512;
};

struct TableS1Setup {
  fs::path denoiser, isp;
  std::string model = "nikon-d850", camera;
  double from = 1600, to = 3200, exposure = 1;
  std::vector<TableS1Row> rows;
};

std::string one_of(const ConfigSection& section, const char* key,
                   const std::vector<std::string>& known) {
  const std::string value = section.text(key).value_or("");
  if (std::find(known.begin(), known.end(), value) == known.end())
    section.fail(key, fmt::format("= \"{}\" is not known", value),
                 fmt::format("use one of {}", fmt::join(known, ", ")));
  return value;
}

TableS1Setup read_table_s1_setup(const fs::path& path) {
  const ConfigSection root = ConfigSection::load(path, "the experiment");
  root.require_known({"denoiser", "isp", "model", "camera", "from", "to", "exposure", "rows"});
  TableS1Setup setup;
  setup.model = root.text("model").value_or(setup.model);
  setup.camera = root.text("camera").value_or(setup.model);
  setup.from = root.number("from").value_or(setup.from);
  setup.to = root.number("to").value_or(setup.to);
  setup.exposure = root.positive_number("exposure").value_or(setup.exposure);
  for (const auto& [key, config] :
       {std::pair{"denoiser", &setup.denoiser}, std::pair{"isp", &setup.isp}}) {
    if (!root.has(key)) root.fail(key, "is missing", "name a training configuration");
    *config = path.parent_path() / *root.text(key);
  }
  for (const ConfigSection& section : root.sections("rows")) {
    section.require_known({"noise", "scheme", "denoiser"});
    TableS1Row row;
    row.scheme = one_of(section, "scheme", {"noise-on-noise", "calibrated", "captured"});
    if (row.scheme != "captured") {
      row.noise = one_of(section, "noise", {"NP", "HG"});
      row.denoiser = one_of(section, "denoiser", {"UNet", "BM3D"});
    }
    setup.rows.push_back(std::move(row));
  }
  if (setup.rows.empty()) root.fail("rows", "are missing", "add [[rows]]");
  return setup;
}

// The experiment's models and captures.
struct TestBench {
  NoiseModel model;
  GainSetting from, to;
  std::vector<RecordedPair> sources, targets;  // training scenes at the two gains
  std::vector<RecordedPair> tests;             // other scenes at the noisier gain
  fs::path folder;
};

std::vector<RecordedPair> joined_lists(std::vector<RecordedPair> one,
                                       const std::vector<RecordedPair>& two) {
  one.insert(one.end(), two.begin(), two.end());
  return one;
}

TestBench open_test_bench(const TableS1Arguments& arguments, const TableS1Setup& setup,
                          const Common& common, Progress& progress) {
  const Model door = Model::load(setup.model);
  TestBench bench{
      door.description(), door.gain_setting(setup.from), door.gain_setting(setup.to), {}, {}, {},
      arguments.folder};
  warn_of_untold_gain(bench.model, setup.model, {bench.from, bench.to});
  if (!arguments.pairs.empty()) {
    const auto captures = open_pairs({arguments.pairs}, &bench.model, {bench.from, bench.to});
    bench.sources = captures_at(captures, bench.from, arguments.pairs);
    bench.targets = captures_at(captures, bench.to, arguments.pairs);
    bench.tests = captures_at(open_pairs({arguments.test_pairs}, &bench.model, {bench.to}),
                              bench.to, arguments.test_pairs);
    return bench;
  }
  const NoiseModel camera = load_model(setup.camera);
  const auto take = [&](const std::vector<fs::path>& pictures, const GainSetting& gain,
                        const char* name, std::uint64_t set) {
    return take_pictures(camera, pictures,
                         {.gain = gain, .exposure = setup.exposure, .crop = arguments.crop},
                         arguments.folder / "captures" / name, common.seed + set, progress);
  };
  bench.sources = take(arguments.pictures, bench.from, "sources", 0);
  bench.targets = take(arguments.pictures, bench.to, "targets", 1);
  bench.tests = take(arguments.test_pictures, bench.to, "tests", 2);
  save_pair_list(joined_lists(bench.sources, bench.targets),
                 arguments.folder / "captures" / "pairs.json");
  save_pair_list(bench.tests, arguments.folder / "captures" / "test-pairs.json");
  return bench;
}

// Frames that a row's ISP is trained on, written beside their list.
std::vector<RecordedPair> make_captures(const TestBench& bench, const TableS1Row& row,
                                        const std::string& weights, const Common& common,
                                        Progress& progress) {
  if (row.scheme == "captured") return bench.targets;
  const FrameMaker make = frame_maker(row, bench.model, bench.from, bench.to);
  DenoiseSettings settings;
  settings.method = row.denoiser == "UNet" ? weights : "bm3d";
  const NoiseModel& model = bench.model;
  const fs::path folder = bench.folder / row.folder() / "frames";
  fs::create_directories(folder);
  SaveOptions save;
  save.force = true;
  save.type = SampleType::kUint16;
  DenoiserByRatio denoisers(settings);
  std::vector<RecordedPair> made;
  for (const RecordedPair& source : bench.sources) {
    check_stop(progress);
    LoadedCapture loaded = load_capture(source, model);
    const Image noisy_dn = above_black(loaded.noisy);
    const NoiseProfile profile = denoising_profile(loaded.noisy, model, bench.from);
    const Image guide_dn =
        denoisers.at(source.ratio)(loaded.noisy, profile, progress).dn_above_black;
    RawFrame frame = std::move(loaded.noisy);
    frame.dn = make(noisy_dn, guide_dn,
                    {.seed = common.seed, .frame = static_cast<std::uint32_t>(made.size())});
    round_as_camera(frame.dn, model.layout,
                    {model.black_dn, model.white_dn, model.quantization_dn});
    frame.gain = bench.to;
    RecordedPair capture = source;
    // A scene may have several frames at a gain, and names may be missing.
    capture.noisy = folder / fmt::format("{}_{}_short.tif", made.size(), source.name);
    capture.gain = bench.to;
    save_frame(capture.noisy, frame, save);
    made.push_back(std::move(capture));
  }
  return made;
}

Json train_and_score(const TestBench& bench, const TableS1Setup& setup, const TableS1Row& row,
                     const std::string& weights, const Common& common, Progress& progress) {
  const std::vector<RecordedPair> made = make_captures(bench, row, weights, common, progress);
  const fs::path list = bench.folder / row.folder() / "pairs.json";
  fs::create_directories(list.parent_path());
  save_pair_list(made, list);
  DenoiseSettings settings;
  settings.method = trained_weights(row.folder() + "/isp",
                                    {.config = setup.isp,
                                     .folder = bench.folder / row.folder() / "isp",
                                     .pairs = {list},
                                     .models = {setup.model}},
                                    common, progress);
  DenoiserByRatio isps(settings);
  PictureScore score;
  for (const RecordedPair& test : bench.tests) {
    check_stop(progress);
    const FrameDenoiser& isp = isps.at(test.ratio);
    if (isp.target() == NetworkTarget::kMosaic)
      throw InputError(setup.isp.string(), "trains a network that gives mosaics",
                       "set target = \"srgb\" or \"rgb\" in [package]");
    add_to_score(score, test, bench.model, &isp);
  }
  const bool captured = row.scheme == "captured";
  const NoiseDivergence noise =
      captured ? NoiseDivergence{} : divergence(made, bench.targets, bench.model);
  Json json{{"noise_model", row.title()},
            {"denoiser", captured ? "-" : row.denoiser},
            {"input", captured                     ? bench.to.text()
                      : row.scheme == "calibrated" ? "Denoised " + bench.from.text()
                                                   : bench.from.text()},
            {"psnr_db", score.psnr_db / score.count},
            {"ssim", score.ssim / score.count}};
  if (noise.captures > 0)
    json.update({{"jsd", noise.jsd},
                 {"jsd_floor", noise.jsd_floor},
                 {"sqrt_jsd", noise.sqrt_jsd},
                 {"sqrt_jsd_floor", noise.sqrt_jsd_floor}});
  return json;
}

std::string table_s1_text(const TestBench& bench, const Json& rows) {
  std::string table = fmt::format(
      "| {} noise model | denoiser | input image | neural ISP PSNR [dB] | SSIM | JSD | its floor "
      "|\n"
      "|---|---|---|---|---|---|---|\n",
      bench.to.text());
  const auto divergence_text = [](const Json& row, const char* key) {
    return row.contains(key) ? fmt::format("{:.5f}", row[key].get<double>()) : std::string("-");
  };
  for (const Json& row : rows)
    table += fmt::format("| {} | {} | {} | {:.2f} | {:.3f} | {} | {} |\n",
                         row["noise_model"].get<std::string>(), row["denoiser"].get<std::string>(),
                         row["input"].get<std::string>(), row["psnr_db"].get<double>(),
                         row["ssim"].get<double>(), divergence_text(row, "jsd"),
                         divergence_text(row, "jsd_floor"));
  return table;
}

// As a record that a report shows (docs/report.md).
Json table_s1_record(const Json& rows) {
  Json table = record_table(
      "Non-parametric Sensor Noise Modeling and Synthesis, Table S1",
      "A neural ISP trained on the frames of each row, scored on captures. Two "
      "samples of one distribution have the floor of the JSD.",
      "noise model, denoiser",
      {{"neural ISP PSNR", "dB"}, {"SSIM", "1"}, {"JSD", "1"}, {"floor of the JSD", "1"}});
  for (const Json& row : rows)
    add_record_row(
        table,
        fmt::format("{}, {}", row["noise_model"].get<std::string>(),
                    row["denoiser"].get<std::string>()),
        {row["psnr_db"], row["ssim"], row.value("jsd", Json()), row.value("jsd_floor", Json())});
  return {{"title", "Noise on noise for a neural ISP"}, {"tables", Json::array({table})}};
}

void run_table_s1(const TableS1Arguments& arguments, const Common& common) {
  const bool captured = !arguments.pairs.empty();
  if (captured != !arguments.test_pairs.empty() || captured == !arguments.pictures.empty() ||
      captured == !arguments.test_pictures.empty())
    throw CLI::ValidationError("scenes to train on and others to score on",
                               "give --pictures and --test-pictures, or --pairs and --test-pairs");
  std::vector<fs::path> read = arguments.pictures;
  read.insert(read.end(), arguments.test_pictures.begin(), arguments.test_pictures.end());
  read.insert(read.end(), {arguments.rows, arguments.pairs, arguments.test_pairs});
  check_report_apart(arguments.report, read, {}, common.force);
  networks();
  const TableS1Setup setup = read_table_s1_setup(arguments.rows);
  const bool denoises = std::any_of(setup.rows.begin(), setup.rows.end(),
                                    [](const TableS1Row& row) { return row.denoiser == "UNet"; });
  if (denoises) check_training({.config = setup.denoiser, .models = {setup.model}}, common);
  // The pairs are made later.
  check_training(
      {.config = setup.isp, .pairs = {arguments.folder / "pairs.json"}, .models = {setup.model}},
      common);
  const OutputFolder output(arguments.folder);
  const auto progress = make_progress(common);
  const TestBench bench = open_test_bench(arguments, setup, common, *progress);
  std::string weights;
  if (denoises)
    weights = trained_weights(
        "denoiser",
        {.config = setup.denoiser, .folder = bench.folder / "denoiser", .models = {setup.model}},
        common, *progress);
  Json rows = Json::array();
  for (const TableS1Row& row : setup.rows)
    rows.push_back(train_and_score(bench, setup, row, weights, common, *progress));
  if (!arguments.report.empty())
    write_record_report(table_s1_record(rows), arguments.report, common.force);
  print_result(common,
               {{"model", setup.model},
                {"from", bench.from.text()},
                {"to", bench.to.text()},
                {"training_scenes", bench.sources.size()},
                {"test_captures", bench.tests.size()},
                {"rows", rows}},
               table_s1_text(bench, rows));
}

}  // namespace

void add_table_s1_experiment(CLI::App& experiment, Common& common) {
  const auto arguments = std::make_shared<TableS1Arguments>();
  CLI::App* command = add_command(
      experiment, common, "table-s1",
      "Table S1 of \"Non-parametric Sensor Noise Modeling and Synthesis\": ways to make "
      "frames of a noisier gain, by what they teach a neural ISP",
      {.seed = true, .force = true}, [arguments, &common] { run_table_s1(*arguments, common); });
  command->add_option("ROWS", arguments->rows, "the table, e.g. experiments/table-s1.toml")
      ->required();
  command->add_option("--pictures", arguments->pictures,
                      "pictures that a simulated camera takes to train on");
  command->add_option("--test-pictures", arguments->test_pictures,
                      "others that the trained networks are scored on");
  command->add_option("--pairs", arguments->pairs,
                      "in their place: captured pairs at both gains (pairs.json of malus pairs)");
  command->add_option("--test-pairs", arguments->test_pairs,
                      "captured pairs of other scenes at the noisier gain");
  command->add_option("-o,--output", arguments->folder, "frames and trainings")->required();
  add_training_settings(*command, common);
  add_crop(*command, arguments->crop, "the pictures");
  command->add_option("--report", arguments->report, "also a report page (HTML)");
}

}  // namespace malus::app
