// The file that an encoder writes a picture into.
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <functional>

namespace malus::internal {

/// Encoders do not tell why a file cannot be written, and some do not notice: this does.
class PictureOutput {
 public:
  explicit PictureOutput(std::FILE* file) : file_(file) {}

  /// How many bytes were taken; fewer where the file cannot be written.
  std::size_t write(const void* bytes, std::size_t size);
  /// whence: SEEK_SET, SEEK_CUR or SEEK_END. Returns the new place.
  std::uint64_t seek(std::int64_t offset, int whence);
  std::uint64_t place() const { return static_cast<std::uint64_t>(::ftello(file_)); }
  /// Hands what is buffered to the file.
  void flush();
  /// errno of what could not be written; 0 where nothing went wrong.
  int reason() const { return reason_; }

 private:
  std::FILE* file_;
  int reason_ = 0;
};

/// Has the whole file written or throws InputError; nothing half-written remains. Devices and pipes
/// have no places to go back to: for these the file is made in memory. `encode` throws InputError
/// for what is wrong beside the file.
void write_encoded(const std::filesystem::path& path, bool force,
                   const std::function<void(PictureOutput&)>& encode);

}  // namespace malus::internal
