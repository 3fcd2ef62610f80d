// A report as one self-contained HTML file, and its plots as SVG files.
#pragma once

#include "malus/report/report.h"

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace malus {

struct ReportSettings {
  double picture_budget_mib = 4.1;  ///< for all pictures, as text in the file
  bool force = false;               ///< an existing file may be replaced
};

/// The HTML text. Pictures that would not fit into the budget exactly are stored in steps of a part
/// of their noise (the page says so), and where even that is too much, binned by whole cells.
std::string report_html(const Report& report, const ReportSettings& settings = {});

/// Writes report_html beside the final name and renames it. Throws InputError.
void write_report(const Report& report, const std::filesystem::path& path,
                  const ReportSettings& settings = {});

/// Makes the folder. Throws InputError where write_figures would, before it writes.
void check_figures(const Report& report, const std::filesystem::path& folder, bool force);

/// Every chart of the report as <section>_<title>[_<variant>].svg, with _2, _3, … behind it where
/// several have the same name; returns the files written. Throws InputError, and where a file
/// exists and force is false before any is written.
std::vector<std::filesystem::path> write_figures(const Report& report,
                                                 const std::filesystem::path& folder, bool force);

}  // namespace malus
