#include "malus/base/folder_lock.h"

#include "malus/base/error.h"

#include <cerrno>

#include <fcntl.h>
#include <fmt/format.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

// Whether a file still has its name: the run that held it before may have removed it meanwhile.
bool is_named(int file, const fs::path& name) {
  struct stat held {
  }, named{};
  return ::fstat(file, &held) == 0 && ::stat(name.c_str(), &named) == 0 &&
         held.st_dev == named.st_dev && held.st_ino == named.st_ino;
}

}  // namespace

FolderLock::FolderLock(const fs::path& folder, std::string_view what) : file_(folder / ".lock") {
  // Open for writing: over NFS a lock that excludes others wants that.
  while ((held_ = ::open(file_.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0666)) >= 0) {
    const bool locked = ::flock(held_, LOCK_EX | LOCK_NB) == 0;
    const bool is_held = !locked && errno == EWOULDBLOCK;
    if (locked && is_named(held_, file_)) return;
    ::close(held_);
    held_ = -1;
    if (is_held)
      throw InputError(folder.string(), fmt::format("another {} is writing into this folder", what),
                       "wait for its end, or name another folder");
    if (!locked) return;
  }
}

// Removed while it is held: a run that has opened it meanwhile finds it without its name.
FolderLock::~FolderLock() {
  if (held_ < 0) return;
  ::unlink(file_.c_str());
  ::close(held_);
}

}  // namespace malus
