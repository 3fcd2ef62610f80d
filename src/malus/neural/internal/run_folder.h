// The folder of a training run: which files a run may replace there, and what a new one finds.
#pragma once

#include "malus/base/atomic_file.h"
#include "malus/base/folder_lock.h"

#include <filesystem>

namespace malus {

class RunFolder {
 public:
  /// Makes the folder, holds it against other runs for as long as it lives, and removes what a
  /// killed run left unfinished. Throws InputError where another run writes there, or a run's files
  /// are there already, but for `force`, and for `resume` where there is a checkpoint to go on
  /// from; a log alone is what a run left that was killed before its first checkpoint.
  RunFolder(const std::filesystem::path& folder, bool resume, bool force);

  std::filesystem::path file(const char* name) const { return path_ / name; }
  /// There is a checkpoint, and the run is to go on from it.
  bool goes_on() const { return goes_on_; }
  /// Removes what an earlier run left: its checkpoint (first), weights and samples.
  void begin() const;
  /// Whether begin() would remove this file.
  bool would_remove(const std::filesystem::path& file_to_read) const;

 private:
  std::filesystem::path path_;
  OutputFolder made_;
  FolderLock lock_;  ///< goes before made_, which looks whether the folder is empty
  bool goes_on_;
};

}  // namespace malus
