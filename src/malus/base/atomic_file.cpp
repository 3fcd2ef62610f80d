#include "malus/base/atomic_file.h"

#include "malus/base/error.h"
#include "malus/base/unfinished_files.h"
#include "malus/base/wording.h"

#include <cerrno>
#include <climits>
#include <cstdio>
#include <cstring>
#include <system_error>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/statvfs.h>
#include <unistd.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

fs::path folder_of(const fs::path& path) {
  return path.parent_path().empty() ? fs::path(".") : path.parent_path();
}

bool is_device(const fs::path& path) {
  std::error_code error;
  const auto type = fs::status(path, error).type();
  return type == fs::file_type::character || type == fs::file_type::fifo ||
         type == fs::file_type::socket;
}

// Whether it is a process's open file, as /dev/stdout is.
bool is_open_stream(fs::path path) {
  constexpr int kMostLinks = 40;  // as many as the system follows
  std::error_code error;
  for (int i = 0; i < kMostLinks; ++i) {
    const fs::path folder = fs::canonical(folder_of(path), error);
    if (error) return false;
    if (folder == "/dev/fd" || (folder.filename() == "fd" && folder.string().starts_with("/proc/")))
      return true;
    const fs::path target = fs::read_symlink(path, error);
    if (error) return false;
    path = folder / target;
  }
  return false;
}

// Whoever made the file meanwhile keeps it, where the file system can tell.
bool renamed(const fs::path& from, const fs::path& to, bool force) {
  if (!force) {
    if (::renameat2(AT_FDCWD, from.c_str(), AT_FDCWD, to.c_str(), RENAME_NOREPLACE) == 0)
      return true;
    if (errno != EINVAL && errno != ENOSYS) return false;
  }
  return std::rename(from.c_str(), to.c_str()) == 0;
}

void require_short_name(const fs::path& path) {
  const std::size_t bytes = path.filename().string().size(),
                    while_written = unfinished_name(path).filename().string().size();
  if (while_written > NAME_MAX)
    throw InputError(path.string(),
                     fmt::format("its name is too long: {} bytes, at most {} can be written", bytes,
                                 NAME_MAX - (while_written - bytes)),
                     "choose a shorter one");
}

[[noreturn]] void exists_already(const fs::path& path) {
  throw InputError(path.string(), "exists already",
                   "use " + setting("force", true) + " to replace it");
}

}  // namespace

void check_output(const fs::path& path, bool force) {
  std::error_code error;
  if (path.filename().empty() || path.filename() == "." || path.filename() == ".." ||
      fs::is_directory(path, error))
    throw InputError(path.string(), "is a folder, not a file name", "name a file to write");
  if (is_device(path)) return;
  // Renaming would replace the link, and the run's own words would be written over the file.
  if (is_open_stream(path))
    throw InputError(path.string(), "is an open stream that leads to no pipe or device",
                     "name the file to write");
  const fs::path folder = folder_of(path);
  if (!fs::is_directory(folder, error))
    throw InputError(path.string(),
                     fmt::format("the folder {} {}", folder.string(),
                                 fs::exists(folder, error) ? "is a file" : "does not exist"),
                     "create the folder or choose another output");
  if (::access(folder.c_str(), W_OK | X_OK) != 0)
    throw InputError(
        path.string(),
        fmt::format("the folder {} cannot be written: {}", folder.string(), std::strerror(errno)),
        "change its permissions or choose another output");
  require_short_name(path);
  if (!force && fs::exists(fs::symlink_status(path, error))) exists_already(path);
}

void make_output_folder(const fs::path& folder) {
  if (folder.empty()) return;
  std::error_code error;
  fs::create_directories(folder, error);
  const std::error_code making = error;
  if (fs::is_directory(folder, error)) return;
  throw InputError(folder.string(),
                   fmt::format("the output folder cannot be made: {}",
                               making ? making.message() : "a file is in the way"),
                   "choose another output folder");
}

OutputFolder::OutputFolder(const fs::path& folder) {
  std::error_code error;
  for (fs::path missing = folder; !missing.empty() && !fs::exists(missing, error);
       missing = missing.parent_path())
    made_.push_back(missing);
  make_output_folder(folder);
}

OutputFolder::~OutputFolder() {
  std::error_code not_empty;
  for (const fs::path& folder : made_) {
    fs::remove(folder, not_empty);
    if (not_empty) return;
  }
}

AtomicFile::AtomicFile(fs::path path, bool force) : path_(std::move(path)), force_(force) {
  check_output(path_, force);
  direct_ = is_device(path_);
  if (!direct_) remove_unfinished_of(path_);
  temporary_ = direct_ ? path_ : unfinished_name(path_);
}

AtomicFile::~AtomicFile() {
  std::error_code ignored;
  if (!direct_ && !committed_) fs::remove(temporary_, ignored);
}

void AtomicFile::commit() {
  MALUS_REQUIRE(!committed_);
  if (!direct_ && !renamed(temporary_, path_, force_)) {
    if (!force_ && errno == EEXIST) exists_already(path_);
    fail(std::strerror(errno));
  }
  committed_ = true;
}

void AtomicFile::fail(std::string_view detail) const {
  // Libraries lose the reason of a failed write, so the disk is asked.
  struct statvfs disk {};
  constexpr unsigned long kFullBelowBytes = 1 << 16;
  const bool full =
      ::statvfs(folder_of(path_).c_str(), &disk) == 0 && disk.f_blocks > 0 &&
      (disk.f_bavail * disk.f_bsize < kFullBelowBytes || (disk.f_files > 0 && disk.f_favail == 0));
  throw InputError(
      path_.string(),
      full ? "cannot be written: the disk is full"
           : fmt::format("cannot be written{}{}", detail.empty() ? "" : ": ", detail),
      full ? "free some space or choose another output" : "check the disk and its permissions");
}

void write_file(const fs::path& path, std::string_view content, bool force) {
  AtomicFile file(path, force);
  std::FILE* stream = std::fopen(file.temporary().c_str(), "wb");
  if (!stream) file.fail(std::strerror(errno));
  errno = 0;
  bool good = std::fwrite(content.data(), 1, content.size(), stream) == content.size();
  good = std::fflush(stream) == 0 && good;
  const int reason = errno;
  good = std::fclose(stream) == 0 && good;
  if (!good) file.fail(reason ? std::strerror(reason) : "");
  file.commit();
}

}  // namespace malus
