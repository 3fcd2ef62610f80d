// One run writes into a folder at a time.
#pragma once

#include <filesystem>
#include <string_view>

namespace malus {

/// A lock on a hidden file in the folder, which the system takes back from a process that ends,
/// however it ends. Where the file system knows no locks, none is held.
class FolderLock {
 public:
  /// Throws InputError where another run holds the folder. what: for the message, "training".
  FolderLock(const std::filesystem::path& folder, std::string_view what);
  ~FolderLock();
  FolderLock(const FolderLock&) = delete;
  FolderLock& operator=(const FolderLock&) = delete;

 private:
  std::filesystem::path file_;
  int held_ = -1;  ///< descriptor; -1: no lock
};

}  // namespace malus
