// Tar shards of training samples, as WebDataset reads them: the files of one sample follow each
// other and share their name up to the first dot. The bytes depend on the content alone (no times,
// no owners), and a shard appears under its name only when it is whole.
#pragma once

#include "malus/base/atomic_file.h"
#include "malus/image/view.h"

#include <filesystem>
#include <fstream>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

/// A .npy file's bytes: float32, [channel, row, column].
std::string npy_bytes(const Planes& planes);

/// Existing files that match a pattern with * ? [..], relative to folder, in counting order; a
/// stack's frame, stack.npy[3], by its name.
std::vector<std::filesystem::path> files_matching(const std::filesystem::path& folder,
                                                  const std::string& pattern);

/// POSIX ustar. Throws InputError when the file cannot be written.
class TarShard {
 public:
  TarShard(const std::filesystem::path& path, bool force);
  /// Contract: name has 1 to 100 characters, content less than 8 GiB.
  void add(std::string_view name, std::string_view content);
  /// Ends the archive and gives it its name; without it nothing remains.
  void commit();

 private:
  void write(std::string_view bytes);
  AtomicFile file_;
  std::ofstream stream_;
};

}  // namespace malus
