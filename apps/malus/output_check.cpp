#include "output_check.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/angle_pictures.h"
#include "malus/io/config_section.h"
#include "malus/io/pair_list.h"
#include "malus/io/shard.h"

#include <algorithm>
#include <set>
#include <system_error>

#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

bool names_one_of(const fs::path& path, const std::vector<fs::path>& others) {
  std::error_code unknown;
  const fs::path whole = fs::weakly_canonical(fs::absolute(path), unknown);
  return std::any_of(others.begin(), others.end(), [&](const fs::path& other) {
    const fs::path file = frame_place(other).file;
    return !file.empty() && fs::weakly_canonical(fs::absolute(file), unknown) == whole;
  });
}

std::vector<fs::path> named_in_config(const fs::path& config) {
  std::vector<fs::path> files;
  for (const std::string& text : ConfigSection::load(config, "the configuration").every_text()) {
    files.emplace_back(text);  // weights and models of an experiment count from here
    const auto found = files_matching(config.parent_path(), text);
    files.insert(files.end(), found.begin(), found.end());
  }
  return files;
}

std::vector<fs::path> frames_in_list(const fs::path& list) {
  std::vector<fs::path> files;
  for (const RecordedPair& pair : load_pair_list(list))
    files.insert(files.end(), {pair.noisy, pair.reference, pair.picture});
  return files;
}

std::vector<fs::path> named_by(const fs::path& path) {
  std::error_code unknown;
  try {
    if (fs::is_directory(path, unknown)) {
      const auto angles = angle_picture_files(path);
      return {angles.begin(), angles.end()};
    }
    if (path.extension() == ".toml") return named_in_config(path);
    if (path.extension() == ".json") return frames_in_list(path);
  } catch (const InputError&) {  // the run says what is wrong with it
  }
  return {};
}

void add_with_named(const fs::path& path, std::set<fs::path>& files) {
  if (!files.insert(path).second) return;
  for (const fs::path& next : named_by(path)) add_with_named(next, files);
}

}  // namespace

void check_report_apart(const fs::path& report, const std::vector<fs::path>& named,
                        const std::vector<fs::path>& written, bool force) {
  std::error_code unknown;
  std::set<fs::path> read;
  if (fs::exists(report, unknown))  // else it is none of them
    for (const fs::path& path : named) add_with_named(path, read);
  check_output_apart("--report", report, {read.begin(), read.end()}, written, force);
}

void check_output_apart(const std::string& flag, const fs::path& path,
                        const std::vector<fs::path>& read, const std::vector<fs::path>& written,
                        bool force) {
  if (path.empty()) return;
  std::error_code unknown;
  const fs::file_status status = fs::status(path, unknown);
  if (fs::exists(status) && !fs::is_regular_file(status)) return check_output(path, force);
  if (names_one_of(path, read))
    throw InputError(fmt::format("{} {}", flag, path.string()), "is an input and would be replaced",
                     "name another file");
  if (names_one_of(path, written))
    throw InputError(fmt::format("{} {}", flag, path.string()),
                     "is the name of another result, which it would replace", "name another file");
  check_output(path, force);
}

std::vector<fs::path> existing_apart(const std::vector<fs::path>& files,
                                     const std::vector<fs::path>& others) {
  std::error_code unknown;
  std::vector<fs::path> apart;
  for (const fs::path& path : files)
    if (fs::is_regular_file(path, unknown) &&
        std::none_of(others.begin(), others.end(), [&](const fs::path& other) {
          return fs::equivalent(path, frame_place(other).file, unknown);
        }))
      apart.push_back(path);
  return apart;
}

std::vector<fs::path> left_in_other_formats(const fs::path& name,
                                            const std::vector<std::string>& formats,
                                            const std::vector<fs::path>& read, bool force) {
  std::vector<fs::path> others;
  for (const std::string& format : formats)
    if (fs::path other = name; other.replace_extension("." + format) != name)
      others.push_back(std::move(other));
  others = existing_apart(others, read);
  if (!others.empty() && !force)
    throw InputError(others.front().string(),
                     fmt::format("exists already, the same result as {} in another format",
                                 name.filename().string()),
                     "use --force to replace it, or another folder");
  return others;
}

void require_format_for(const std::string& format, SampleType type) {
  try {
    require_ending_for("result." + format, type);
  } catch (const InputError& error) {
    throw CLI::ValidationError("--format " + format, error.problem() + "; " + error.remedy());
  }
}

std::vector<fs::path> files_read(const Session& session) {
  std::vector<fs::path> files{session.source};
  for (const FrameGroup& group : session.groups)
    files.insert(files.end(), group.paths.begin(), group.paths.end());
  return files;
}

}  // namespace malus::app
