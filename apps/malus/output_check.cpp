#include "output_check.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"

#include <algorithm>
#include <system_error>

#include <fmt/format.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

bool names_one_of(const fs::path& path, const std::vector<fs::path>& others) {
  std::error_code unknown;
  const fs::path whole = fs::weakly_canonical(fs::absolute(path), unknown);
  return std::any_of(others.begin(), others.end(), [&](const fs::path& other) {
    return !other.empty() && fs::weakly_canonical(fs::absolute(other), unknown) == whole;
  });
}

}  // namespace

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

std::vector<fs::path> files_read(const Session& session) {
  std::vector<fs::path> files{session.source};
  for (const FrameGroup& group : session.groups)
    files.insert(files.end(), group.paths.begin(), group.paths.end());
  return files;
}

}  // namespace malus::app
