// Outputs that one run names twice, or that it reads: --force may replace earlier results, never
// what a run works with.
#pragma once

#include "malus/io/picture_file.h"
#include "malus/io/session.h"

#include <filesystem>
#include <string>
#include <vector>

namespace malus::app {

/// check_output (base/atomic_file.h); besides throws InputError, naming the flag, where path is one
/// of the files that the run reads or that it writes under another flag. An empty path is none; to
/// a device or pipe everything may be written.
void check_output_apart(const std::string& flag, const std::filesystem::path& path,
                        const std::vector<std::filesystem::path>& read,
                        const std::vector<std::filesystem::path>& written, bool force);

/// Those of the files that exist and are none of the others.
std::vector<std::filesystem::path> existing_apart(const std::vector<std::filesystem::path>& files,
                                                  const std::vector<std::filesystem::path>& others);

/// The result of this name as an earlier run left it in another of the formats (endings without
/// their dot): it goes when this one is written, or would be taken for it. Throws InputError,
/// naming the file, where there is one and force is false. read: what is none of it.
std::vector<std::filesystem::path> left_in_other_formats(
    const std::filesystem::path& name, const std::vector<std::string>& formats,
    const std::vector<std::filesystem::path>& read, bool force);

/// A result, and what an earlier run left that goes as it is written.
struct PlannedFile {
  std::filesystem::path name;
  std::vector<std::filesystem::path> stale;
};

/// Throws CLI::ValidationError, naming --format, where files of this ending cannot hold the type.
void require_format_for(const std::string& format, SampleType type);

/// What a command reads that works on a session: the session file and all its frames.
std::vector<std::filesystem::path> files_read(const Session& session);

/// --report of a run that is given scenes, configurations and lists: as check_output_apart, where
/// the run reads what is named and all files behind it: of a folder its I0, I45, I90 and I135, of a
/// configuration (.toml) and a list of pairs (.json) what they name in turn.
void check_report_apart(const std::filesystem::path& report,
                        const std::vector<std::filesystem::path>& named,
                        const std::vector<std::filesystem::path>& written, bool force);

}  // namespace malus::app
