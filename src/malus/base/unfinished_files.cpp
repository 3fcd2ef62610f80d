#include "malus/base/unfinished_files.h"

#include <array>
#include <atomic>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <fstream>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <system_error>
#include <vector>

#include <fmt/format.h>
#include <signal.h>
#include <unistd.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

constexpr std::chrono::hours kAbandonedAfter{24};

// Hosts may have one name, containers one machine: together with the kernel's start and the space
// of process numbers it is told apart whose a process number is.
const std::string& where() {
  static const std::string tag = [] {
    std::array<char, 256> host{};
    ::gethostname(host.data(), host.size() - 1);
    std::string start;
    std::getline(std::ifstream("/proc/sys/kernel/random/boot_id"), start);
    std::error_code unknown;
    const std::string processes = fs::read_symlink("/proc/self/ns/pid", unknown).string();
    const std::size_t hash =
        std::hash<std::string>()(host.data() + ("/" + start) + "/" + processes);
    return fmt::format("{:08x}", hash & 0xffffffff);
  }();
  return tag;
}

struct UnfinishedName {
  std::string_view where, name;
  pid_t process;
};

std::optional<UnfinishedName> parsed(std::string_view file) {
  const std::size_t first = file.find('-'), second = file.find('-', first + 1),
                    third = file.find('-', second + 1);
  if (!file.starts_with('.') || first == file.npos || second == file.npos || third == file.npos)
    return std::nullopt;
  UnfinishedName found{file.substr(1, first - 1), file.substr(third + 1), 0};
  const char* end = file.data() + second;
  const auto [stop, error] = std::from_chars(file.data() + first + 1, end, found.process);
  if (error != std::errc() || stop != end || found.process <= 0) return std::nullopt;
  return found;
}

bool has_ended(pid_t process) { return ::kill(process, 0) != 0 && errno == ESRCH; }

bool is_abandoned(const fs::path& path, const UnfinishedName& name) {
  if (name.where == where()) return has_ended(name.process);
  std::error_code error;
  const auto written = fs::last_write_time(path, error);
  return !error && fs::file_time_type::clock::now() - written > kAbandonedAfter;
}

std::vector<fs::path> unfinished_in(const fs::path& folder) {
  std::error_code error;
  std::vector<fs::path> paths;
  for (fs::directory_iterator at(folder, error), end; !error && at != end; at.increment(error))
    if (parsed(at->path().filename().string())) paths.push_back(at->path());
  return paths;
}

}  // namespace

fs::path unfinished_name(const fs::path& path) {
  static std::atomic<unsigned> counter{0};
  return path.parent_path() /
         fmt::format(".{}-{}-{}-{}", where(), ::getpid(), counter++, path.filename().string());
}

int remove_unfinished(const fs::path& folder,
                      const std::function<bool(std::string_view name)>& wanted) {
  std::error_code error;
  int removed = 0;
  for (const fs::path& path : unfinished_in(folder)) {
    const std::string file = path.filename().string();
    const auto name = parsed(file);
    if (wanted(name->name) && is_abandoned(path, *name)) removed += fs::remove(path, error) ? 1 : 0;
  }
  return removed;
}

void remove_unfinished_of(const fs::path& path) {
  static std::mutex mutex;
  static std::map<fs::path, std::vector<fs::path>> found;  // by folder
  std::error_code error;
  const fs::path folder = fs::absolute(path.parent_path() / ".", error);
  if (error) return;
  const std::lock_guard lock(mutex);
  auto at = found.find(folder);
  if (at == found.end()) at = found.emplace(folder, unfinished_in(folder)).first;
  std::erase_if(at->second, [&](const fs::path& left) {
    const std::string file = left.filename().string();
    const auto name = parsed(file);
    return name->where == where() && name->name == path.filename().string() &&
           has_ended(name->process) && fs::remove(left, error);
  });
}

}  // namespace malus
