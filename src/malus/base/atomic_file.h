// Outputs appear under their name only when they are whole: written beside it and renamed. Every
// writer of malus goes through this.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

/// Fails early, before hours of work: throws InputError when path exists and force is false, is a
/// folder, lies in a folder that is missing or cannot be written, has too long a name, or is an
/// open stream (/dev/stdout) that leads to a file.
void check_output(const std::filesystem::path& path, bool force);

/// Makes the folder and its parents where they are missing; throws InputError when that fails or a
/// file is in the way.
void make_output_folder(const std::filesystem::path& folder);

/// make_output_folder for the time of a run: what it made and what is empty still goes again at the
/// end, so a refused run leaves no folder.
class OutputFolder {
 public:
  explicit OutputFolder(const std::filesystem::path& folder);
  ~OutputFolder();
  OutputFolder(const OutputFolder&) = delete;
  OutputFolder& operator=(const OutputFolder&) = delete;

 private:
  std::vector<std::filesystem::path> made_;  ///< the innermost first
};

/// A file under construction. Without commit() nothing remains of it. An existing device or pipe
/// (/dev/null, /dev/stdout where it is one) is written directly. What a killed run left of the same
/// file goes (unfinished_files.h).
class AtomicFile {
 public:
  /// As check_output.
  AtomicFile(std::filesystem::path path, bool force);
  ~AtomicFile();
  AtomicFile(const AtomicFile&) = delete;
  AtomicFile& operator=(const AtomicFile&) = delete;

  /// Where to write: same folder and ending as the final name.
  const std::filesystem::path& temporary() const { return temporary_; }
  const std::filesystem::path& path() const { return path_; }
  /// Gives the file its name; the writer has closed it without error. Throws InputError, also where
  /// a file of that name has come up meanwhile and none is to be replaced.
  void commit();
  /// The one line for a failed write or close; detail is the library's own message, or empty.
  /// Names the full disk where that is the cause.
  [[noreturn]] void fail(std::string_view detail = {}) const;

 private:
  std::filesystem::path path_, temporary_;
  bool force_, direct_ = false, committed_ = false;
};

/// The whole content at once.
void write_file(const std::filesystem::path& path, std::string_view content, bool force);

}  // namespace malus
