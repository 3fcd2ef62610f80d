// malus report: models, evaluations, denoise runs and records as one HTML file.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/report/write_report.h"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>

#include "denoise_run.h"
#include "flags.h"
#include "output_check.h"
#include "program.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct ReportArguments {
  std::vector<fs::path> inputs;
  fs::path output, figures;
  std::string title;
  double budget_mib = ReportSettings{}.picture_budget_mib;
};

// What one input contributes.
struct Page {
  std::string title, subtitle;
  std::vector<Section> sections;
};

bool is_json(const fs::path& path) { return path.extension() == ".json"; }
bool is_model(const fs::path& path) {
  return path.extension() == ".h5" || path.extension() == ".hdf5";
}

Json load_json(const fs::path& path) {
  std::ifstream file(path);
  if (!file) throw InputError(path.string(), "cannot be read", "check the name");
  Json json;
  try {
    json = Json::parse(file);
  } catch (const Json::exception& error) {  // out_of_range where a number is no double
    throw InputError(path.string(), std::string("is not JSON: ") + error.what(),
                     "give a model (.h5), or JSON that malus wrote");
  }
  if (!json.is_object())
    throw InputError(path.string(), "is not a JSON object", "give JSON that malus wrote");
  return json;
}

Page json_page(const fs::path& path, const Json& json, const std::string& prefix) {
  const std::string name = path.filename().string();
  if (json.value("kind", "") == "denoise") {
    DenoisedFrame frame = load_run(path, json);
    Page page{"Denoising of " + fs::path(frame.before.source).filename().string(),
              fmt::format("{}, {}, {} × {} px", frame.before.layout.name(),
                          frame.before.gain.text(), frame.before.dn.cols(), frame.before.dn.rows()),
              denoise_sections(frame, prefix)};
    return page;
  }
  if (json.contains("image") || json.contains("results"))
    return {"Evaluation", name, evaluation_sections(json, prefix)};
  if (json.contains("charts") || json.contains("tables")) {
    Page page{json.value("title", name), name, record_sections(json, path.parent_path(), prefix)};
    return page;
  }
  throw InputError(path.string(), "holds neither an evaluation, a denoise run nor a record",
                   "give the output of evaluate --json, or a <stem>_denoised.json; docs/report.md "
                   "has the record's format");
}

// A file that is not called a model may have been meant for something else.
NoiseModel model_of(const fs::path& path) {
  try {
    return load_model(path);
  } catch (const InputError& error) {
    if (is_model(path) || !fs::is_regular_file(path)) throw;
    throw InputError(path.string(), error.problem(),
                     "give a noise model (.h5), evaluate's JSON, a <stem>_denoised.json, or a "
                     "folder of them");
  }
}

Page page_of(const fs::path& path, const std::string& prefix) {
  if (is_json(path)) {
    const Json json = load_json(path);
    try {
      return json_page(path, json, prefix);
    } catch (const Json::exception& error) {
      throw InputError(path.string(),
                       std::string("does not hold what a page needs: ") + error.what(),
                       "give JSON that malus wrote; docs/report.md has the record's format");
    }
  }
  const NoiseModel model = model_of(path);
  return {calibration_title(model), calibration_subtitle(model),
          calibration_sections(model, prefix)};
}

struct ReportInput {
  fs::path path;
  bool of_folder = false;  ///< nobody named it: what cannot be shown is left out
};

// Folders give what is in them, in order of their names.
std::vector<ReportInput> all_inputs(const std::vector<fs::path>& given) {
  std::vector<ReportInput> inputs;
  for (const fs::path& path : given) {
    if (!fs::is_directory(path)) {
      inputs.push_back({path});
      continue;
    }
    std::vector<fs::path> inside;
    for (const auto& entry : fs::directory_iterator(path))
      if (entry.is_regular_file() && (is_json(entry.path()) || is_model(entry.path())))
        inside.push_back(entry.path());
    if (inside.empty())
      throw InputError(path.string(), "holds no model (.h5) and no JSON",
                       "give a folder that calibrate, evaluate or denoise wrote to; a training's "
                       "page: malus train CONFIG --resume --report FILE");
    std::sort(inside.begin(), inside.end());
    for (fs::path& file : inside) inputs.push_back({std::move(file), true});
  }
  return inputs;
}

// What records name: "file" of a picture; "input_file", "result_file" and "reference_file" of a
// denoise run.
void add_files_in(const Json& record, const fs::path& folder, std::vector<fs::path>& files) {
  std::vector<const Json*> left = {&record};  // not by recursion: anybody wrote the file
  while (!left.empty()) {
    const Json& json = *left.back();
    left.pop_back();
    for (const auto& [key, value] : json.items()) {
      if (value.is_structured()) left.push_back(&value);
      if (value.is_string() && json.is_object() && (key == "file" || key.ends_with("_file")))
        files.push_back(folder / value.get<std::string>());
    }
  }
}

// The inputs and all files behind them. What is wrong with one is said when its page is made.
std::vector<fs::path> files_behind(const std::vector<ReportInput>& inputs) {
  std::vector<fs::path> files;
  for (const auto& [path, of_folder] : inputs) {
    files.push_back(path);
    if (!is_json(path)) continue;
    std::ifstream file(path);
    const Json json = Json::parse(file, nullptr, /*allow_exceptions=*/false);
    if (json.is_object()) add_files_in(json, path.parent_path(), files);
  }
  return files;
}

// Some errors are of the file itself, others of one that it names.
std::string left_out_line(const fs::path& path, const std::string& error) {
  return "left out: " + (error.starts_with(path.string()) ? "" : path.string() + ": ") + error;
}

// What a folder held and the report does not.
Section left_out_section(const std::vector<std::string>& lines) {
  NoticesBlock notices;
  for (const std::string& line : lines) notices.items.push_back({NoticeLevel::kWarning, line});
  return {"left-out", "Left out", "Files of the folder that could not be shown.", {notices}};
}

Report report_of(const ReportArguments& arguments, const std::vector<ReportInput>& inputs) {
  std::string title, subtitle;
  std::vector<Section> sections;
  std::vector<std::string> left_out;
  for (std::size_t i = 0; i < inputs.size(); ++i) {
    Page page;
    try {
      page = page_of(inputs[i].path, inputs.size() == 1 ? "" : fmt::format("{}-", i + 1));
    } catch (const InputError& error) {
      left_out.push_back(left_out_line(inputs[i].path, error.what()));
      if (!inputs[i].of_folder || left_out.size() == inputs.size()) throw;
      warn(left_out.back());
      continue;
    }
    for (Section& section : page.sections) {
      if (inputs.size() > 1) section.title += ", " + inputs[i].path.filename().string();
      sections.push_back(std::move(section));
    }
    title = std::move(page.title);
    subtitle = std::move(page.subtitle);
  }
  if (inputs.size() > 1) {
    const std::size_t shown = inputs.size() - left_out.size();
    title = "Report of " + counted(std::int64_t(shown), "file");
    subtitle.clear();
  }
  if (!left_out.empty()) sections.push_back(left_out_section(left_out));
  return make_report(arguments.title.empty() ? title : arguments.title, subtitle,
                     std::move(sections));
}

void run_report(const ReportArguments& arguments, const Common& common) {
  if (arguments.output.empty() && arguments.figures.empty())
    throw CLI::RequiredError("one of --output and --figures");
  const std::vector<ReportInput> inputs = all_inputs(arguments.inputs);
  check_output_apart("--output", arguments.output, files_behind(inputs), {}, common.force);
  const Report report = report_of(arguments, inputs);
  // Before the page: a folder that is refused leaves none behind, nor a page that fails a folder.
  std::optional<OutputFolder> figures;
  if (!arguments.figures.empty()) {
    figures.emplace(arguments.figures);
    check_figures(report, arguments.figures, common.force);
  }
  Json files = Json::array();
  if (!arguments.output.empty()) {
    write_report(report, arguments.output,
                 {.picture_budget_mib = arguments.budget_mib, .force = common.force});
    files.push_back(arguments.output.string());
  }
  if (!arguments.figures.empty())
    for (const fs::path& path : write_figures(report, arguments.figures, common.force))
      files.push_back(path.string());
  std::string text;
  for (const Json& file : files) text += file.get<std::string>() + "\n";
  print_result(common, {{"title", report.title}, {"files", files}}, text);
}

}  // namespace

void add_report(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<ReportArguments>();
  CLI::App* command = add_command(
      app, common, "report", "Models, evaluations and denoise runs as one self-contained HTML file",
      {.force = true}, [arguments, &common] { run_report(*arguments, common); });
  command
      ->add_option("INPUT", arguments->inputs,
                   "models (.h5 or a built-in name), evaluate's JSON, <stem>_denoised.json, or "
                   "folders of them")
      ->required();
  command->add_option("-o,--output", arguments->output, "the HTML file");
  command->add_option("--figures", arguments->figures, "folder for every plot as SVG");
  command->add_option("--title", arguments->title, "title of the report");
  command
      ->add_option("--picture-budget", arguments->budget_mib,
                   "space for all pictures in the file [MiB]")
      ->check(in_range(0.1, 512.0))
      ->capture_default_str();
}

}  // namespace malus::app
