#include "denoise_checks.h"

#include "malus/base/text.h"
#include "malus/denoise/frame_complaints.h"

#include <algorithm>
#include <string>

#include "denoise_method.h"
#include "program.h"
#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

// The offsets that were taken out.
std::string lines_text(const Denoised& result) {
  const double rows = result.row_noise_removed_dn, columns = result.column_noise_removed_dn;
  return columns > 0
             ? fmt::format("row noise {:.2f} DN and column noise {:.2f} DN removed", rows, columns)
             : fmt::format("row noise {:.2f} DN removed", rows);
}

// What else was taken out of the frame; empty where nothing was.
std::string corrections_text(const Denoised& result) {
  std::string text;
  for (const auto& [count, name] : {std::pair{result.defect_pixels, "defect pixels filled"},
                                    {result.impulse_pixels, "impulses filled"},
                                    {result.kept_pixels, "pixels kept that no noise explains"}})
    if (count > 0) text += fmt::format(", {} {}", count, name);
  for (const auto& [share, name] : {std::pair{result.dark_pattern_share, "dark shading"},
                                    {result.response_pattern_share, "PRNU"}})
    if (share > 0) text += fmt::format(", {:.2f} of the model's {} taken out", share, name);
  return text;
}

}  // namespace

void check_states_error(const std::string& asked, const std::string& method) {
  if (is_weight_file(method) || denoise_method(method).on_mosaic()) return;
  throw CLI::ValidationError(
      asked, fmt::format("{} gives none: leave it out, or use nl-ridge or bm3d", method));
}

void warn_of_result(const RawFrame& before, const Denoised& result, const NoiseProfile& profile,
                    const std::string& network) {
  for (const std::string& line : result_complaints(before, result, profile, network))
    warn_of(before.source, line);
}

void warn_of_model(const NoiseModel& model, const GainSetting& gain, const fs::path& path,
                   bool undone) {
  for (const std::string& line : complaints_at_gain(model, gain, undone))
    warn_of(path.string(), line);
}

void warn_of_picture(const std::string& source, const NetworkInference::Rendered& made) {
  for (const std::string& line : picture_complaints(made)) warn_of(source, line);
}

nlohmann::ordered_json noise_json(const Denoised& result) {
  if (!result.noise) return nullptr;
  return {{"frame_sd_dn", result.noise->frame_sd_dn},
          {"model_sd_dn", result.noise->profile_sd_dn},
          {"texture_share", result.noise->texture_share},
          {"below_dark_share", result.noise->below_dark_share},
          {"complaint", noise_complaint(*result.noise)}};
}

std::string run_text(const RunSummary& run, const std::string& method, const fs::path& file) {
  return fmt::format("{}: {} x {} {}, {}, {}{}, {:.1f} s -> {}\n", run.frame.source, run.cols,
                     run.rows, run.frame.layout.name(), method, lines_text(run.result),
                     corrections_text(run.result), run.seconds, file.string());
}

}  // namespace malus::app
