// malus train: a network from a configuration file; one process, or many that torchrun, mpirun or
// srun started.
#include "malus/base/text.h"

#include <filesystem>
#include <memory>

#include "networks_door.h"
#include "output_check.h"
#include "program.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct TrainArguments {
  fs::path config, folder, report;
  bool resume = false;
};

// The log's value of a key over the steps.
Json training_curve(const Json& log, const char* key) {
  Json x = Json::array(), y = Json::array();
  for (const Json& line : log)
    if (line.contains(key)) {
      x.push_back(line["step"]);
      y.push_back(line[key]);
    }
  return {{"name", key}, {"x", x}, {"y", y}};
}

Json validation_curve(const Json& log, const char* metric, const char* name) {
  Json x = Json::array(), y = Json::array();
  for (const Json& line : log)
    if (line.contains("validation")) {
      x.push_back(line["step"]);
      y.push_back(line["validation"][metric]);
    }
  return {{"name", name}, {"x", x}, {"y", y}};
}

// The metrics of a validation, those of polarization where the layout has them.
struct ValidationMetric {
  const char* key;
  const char* name;
  const char* unit;
  const char* of;
};
constexpr ValidationMetric kValidationMetrics[] = {
    {"image_psnr_db", "image PSNR", "dB", "image"},
    {"dolp_psnr_db", "DoLP PSNR", "dB", "DoLP"},
    {"aolp_circular_deg", "AoLP circular error", "deg", "AoLP"}};

Json validation_table(const Json& run, const Json& last) {
  std::vector<std::pair<std::string, std::string>> columns;
  for (const auto& [key, metric, unit, part] : kValidationMetrics)
    if (last.contains(key)) columns.emplace_back(metric, unit);
  Json table = record_table("Last validation", "", "frames", columns);
  const auto add_row = [&](const char* name, const Json& score) {
    Json cells = Json::array();
    for (const auto& [key, metric, unit, part] : kValidationMetrics)
      if (last.contains(key)) cells.push_back(score[key]);
    add_record_row(table, name, cells);
  };
  add_row("noisy", run["noisy"]);
  if (run.contains("guide")) add_row("guide", run["guide"]);
  add_row("network", last);
  return table;
}

std::string score_text(const std::string& of, const Json& score) {
  std::vector<std::string> parts;
  for (const auto& [key, name, unit, part] : kValidationMetrics)
    if (score.contains(key))
      parts.push_back(fmt::format("{} {:.2f} {}", part, score[key].get<double>(), unit));
  return fmt::format("{}: {}\n", of, fmt::join(parts, ", "));
}

// Curves, the last validation and a sample of it, as a record that a report shows (docs/report.md).
Json record_of(const Json& run) {
  const Json& log = run["log"];
  const Json steps = {{"name", "step"}, {"unit", "1"}};
  Json record{{"title", fmt::format("Training of {}", run["architecture"].get<std::string>())},
              {"text", fmt::format("{}, {} in {:.0f} s on {}, {}",
                                   counted(run["parameters"].get<std::int64_t>(), "parameter"),
                                   counted(run["steps"].get<std::int64_t>(), "step"),
                                   run["seconds"].get<double>(), run["device"].get<std::string>(),
                                   counted(run["workers"].get<int>(), "worker"))},
              {"tables", Json::array()},
              {"charts", Json::array()}};
  const auto chart = [&](const char* title, const char* unit, Json series) {
    record["charts"].push_back({{"title", title},
                                {"x", steps},
                                {"y", {{"name", title}, {"unit", unit}}},
                                {"series", std::move(series)}});
  };
  chart("Loss", "1", Json::array({training_curve(log, "loss")}));
  chart("Learning rate", "1", Json::array({training_curve(log, "rate")}));
  if (run.contains("sample")) record["pictures"] = Json::array({run["sample"]});
  Json last;
  for (const Json& line : log)
    if (line.contains("validation")) last = line["validation"];
  if (last.is_null()) return record;
  Json curves = Json::array();
  for (const auto& [key, name, unit, part] : kValidationMetrics)
    if (last.contains(key) && unit == std::string_view("dB"))
      curves.push_back(validation_curve(log, key, name));
  chart("Validation", "dB", std::move(curves));
  record["tables"].push_back(validation_table(run, last));
  return record;
}

// Single steps see a few patches: the mean over the first or last fifth of some lines of the log.
enum class Fifth { kFirst, kLast };

double mean_of_fifth(const Json& lines, const char* key, Fifth fifth) {
  const std::size_t count = (lines.size() + 4) / 5;
  const std::size_t begin = fifth == Fifth::kFirst ? 0 : lines.size() - count;
  double sum = 0;
  for (std::size_t i = begin; i < begin + count; ++i) sum += lines[i][key].get<double>();
  return sum / static_cast<double>(count);
}

std::string loss_text(const Json& log) {
  if (!log.empty() && log.back().contains("log_likelihood"))  // a noise-flow's
    return fmt::format(
        "log-likelihood of a noisy pixel {:.4g} nats, at the start {:.4g} (last and first fifth of "
        "the log)\n",
        mean_of_fifth(log, "log_likelihood", Fifth::kLast),
        mean_of_fifth(log, "log_likelihood", Fifth::kFirst));
  Json measured = Json::array();
  for (const Json& line : log)
    if (line.contains("base_loss")) measured.push_back(line);
  if (measured.empty()) return {};
  return fmt::format("loss {:.4g}, that of the input {:.4g} (last fifth of the log)\n",
                     mean_of_fifth(measured, "loss", Fifth::kLast),
                     mean_of_fifth(measured, "base_loss", Fifth::kLast));
}

void run_train(const TrainArguments& arguments, const Common& common) {
  const fs::path folder =
      arguments.folder.empty() ? fs::path(arguments.config).replace_extension() : arguments.folder;
  std::vector<fs::path> written;
  for (const char* name :
       {"weights.safetensors", "best.safetensors", "checkpoint.safetensors", "log.jsonl"})
    written.push_back(folder / name);
  check_report_apart(arguments.report, {arguments.config}, written, common.force);
  const bool begun = arguments.resume && !fs::exists(folder / "checkpoint.safetensors");
  const NetworkFunctions& functions = networks();
  const auto progress = make_progress(common);
  Json run = functions.train({.config = arguments.config,
                              .folder = folder,
                              .resume = arguments.resume,
                              .force = common.force,
                              .seed = common.seed,
                              .settings = common.settings},
                             *progress);
  if (run.contains("rank")) return;  // worker 0 speaks for all
  if (begun && !run.contains("finished_before"))
    note(common, fmt::format("{}: held no checkpoint, training began at step 0", folder.string()));
  if (!arguments.report.empty())
    write_record_report(record_of(run), arguments.report, common.force, folder);
  std::string text = fmt::format(
      "{}: {} in {:.0f} s{}\n", run["weights"].get<std::string>(),
      counted(run["steps"].get<std::int64_t>(), "step"), run["seconds"].get<double>(),
      run.contains("finished_before") ? ", finished before: nothing was left to train" : "");
  text += loss_text(run["log"]);
  for (const char* before : {"noisy", "guide"})
    if (run.contains(before)) text += score_text(before, run[before]);
  for (const Json& line : run["log"])
    if (line.contains("validation"))
      text +=
          score_text(fmt::format("step {}", line["step"].get<std::int64_t>()), line["validation"]);
  print_result(common, run, text);
}

}  // namespace

void add_train(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<TrainArguments>();
  CLI::App* command = add_command(
      app, common, "train", "Train a network on synthetic or captured noise",
      {.seed = true, .force = true}, [arguments, &common] { run_train(*arguments, common); });
  command->add_option("CONFIG", arguments->config, "configuration (TOML)")->required();
  command->add_option("-o,--output", arguments->folder,
                      "folder of checkpoint, log and weights; the configuration's name without its "
                      "ending when left out");
  add_training_settings(*command, common);
  command->add_flag("--resume", arguments->resume, "go on from the folder's last checkpoint");
  command->add_option("--report", arguments->report, "also a report page (HTML)");
}

}  // namespace malus::app
