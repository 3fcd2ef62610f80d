// What malus measured, as pages of a report: translations of models, denoise runs and evaluations
// into the blocks of malus/report/report.h. Functions that take JSON throw nlohmann's exceptions
// where it does not hold what they need; who read it from a file names the file.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/model.h"
#include "malus/report/report.h"

#include <filesystem>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::app {

/// Photon transfer, bias statistics, correlations, laws over gain, distributions, fixed pattern and
/// data sheet of a model (000 Fig. 2-5). prefix tells sections of several models apart.
std::vector<Section> calibration_sections(const NoiseModel& model, const std::string& prefix = "");

/// "Calibration of <sensor>"; layout, number of channels, and what it was measured from.
std::string calibration_title(const NoiseModel& model);
std::string calibration_subtitle(const NoiseModel& model);

/// One denoised frame.
struct DenoisedFrame {
  RawFrame before;       ///< as loaded: black level in
  Image after_dn;        ///< DN above black, bias removed
  NoiseProfile profile;  ///< what was taken out
  Image variance_dn2;    ///< of after_dn; may be empty
  /// The clean scene in the frame's own light, DN above black; may be empty.
  Image reference_dn;
  double reference_peak_dn = 0;  ///< what PSNR counts as white, in the frame's own light
  std::vector<Quantity> metrics_before, metrics_after;  ///< by measure_before, measure_after
  nlohmann::ordered_json run;  ///< settings and timings as `denoise --json` prints them
};
/// Pictures before and after, what was done, metrics where there is a reference.
std::vector<Section> denoise_sections(const DenoisedFrame& frame, const std::string& prefix = "");

/// `evaluate --json`, of one or several tests. Without a prefix as record_sections.
std::vector<Section> evaluation_sections(const nlohmann::ordered_json& evaluation,
                                         const std::string& prefix = "");

/// Curves, tables and sample pictures of a training or an experiment; docs/report.md has the
/// format. folder: what the pictures' file names are relative to. Without a prefix the section is
/// the page's only one, whose title has said what it is of.
std::vector<Section> record_sections(const nlohmann::ordered_json& record,
                                     const std::filesystem::path& folder = {},
                                     const std::string& prefix = "");

/// A table of such a record, without rows; columns: name and unit of each.
nlohmann::ordered_json record_table(
    const std::string& title, const std::string& note, const std::string& head,
    const std::vector<std::pair<std::string, std::string>>& columns);
/// A row of it; cells: one per column, null where there is no value.
void add_record_row(nlohmann::ordered_json& table, const std::string& name,
                    const nlohmann::ordered_json& cells);

/// What a run's JSON lists under "warnings".
NoticesBlock warning_notices(const nlohmann::ordered_json& run);

/// A report of sections, with this program's name.
Report make_report(const std::string& title, const std::string& subtitle,
                   std::vector<Section> sections);

/// For `calibrate --report`.
void write_calibration_report(const NoiseModel& model, const std::filesystem::path& path,
                              bool force);
/// For `denoise --report`.
void write_denoise_report(const std::vector<DenoisedFrame>& frames,
                          const std::filesystem::path& path, bool force);
/// For `train --report` and `experiment --report`; folder as for record_sections.
void write_record_report(const nlohmann::ordered_json& record, const std::filesystem::path& path,
                         bool force, const std::filesystem::path& folder = {});
/// For `evaluate --report`.
void write_evaluation_report(const nlohmann::ordered_json& evaluation,
                             const std::filesystem::path& path, bool force);

}  // namespace malus::app
