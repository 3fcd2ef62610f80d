// Outputs that one run names twice, or that it reads: --force may replace earlier results, never
// what a run works with.
#pragma once

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

/// What a command reads that works on a session: the session file and all its frames.
std::vector<std::filesystem::path> files_read(const Session& session);

}  // namespace malus::app
