#include "malus/io/internal/picture_output.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/io/internal/file_bytes.h"

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <new>
#include <string>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

using Encode = std::function<void(PictureOutput&)>;

// Returns errno of what could not be written; 0 where nothing went wrong.
int encode_into(std::FILE* file, const Encode& encode) {
  PictureOutput output(file);
  try {
    encode(output);
  } catch (const InputError&) {
    if (output.reason() == 0) throw;  // else the disk is what is to be said
  }
  output.flush();
  return output.reason();
}

struct MemoryFile {
  char* bytes = nullptr;
  std::size_t size = 0;
  OpenFile stream{::open_memstream(&bytes, &size)};

  MemoryFile() = default;
  MemoryFile(const MemoryFile&) = delete;
  MemoryFile& operator=(const MemoryFile&) = delete;
  ~MemoryFile() {
    stream.reset();
    std::free(bytes);
  }
};

void encode_to_device(const fs::path& path, const Encode& encode) {
  MemoryFile memory;
  if (!memory.stream || encode_into(memory.stream.get(), encode) != 0) throw std::bad_alloc();
  std::fseek(memory.stream.get(), 0, SEEK_END);  // the size is that of the place
  std::fflush(memory.stream.get());
  write_file(path, {memory.bytes, memory.size}, true);
}

}  // namespace

std::size_t PictureOutput::write(const void* bytes, std::size_t size) {
  errno = 0;
  const std::size_t done = std::fwrite(bytes, 1, size, file_);
  if (done != size && reason_ == 0) reason_ = errno != 0 ? errno : EIO;
  return done;
}

std::uint64_t PictureOutput::seek(std::int64_t offset, int whence) {
  errno = 0;
  // What is buffered is written first.
  if (::fseeko(file_, offset, whence) != 0 && reason_ == 0) reason_ = errno != 0 ? errno : EIO;
  return place();
}

void PictureOutput::flush() {
  if (std::fflush(file_) != 0 && reason_ == 0) reason_ = errno;
}

void write_encoded(const fs::path& path, bool force, const Encode& encode) {
  AtomicFile file(path, force);
  if (file.temporary() == file.path()) return encode_to_device(path, encode);
  OpenFile stream(std::fopen(file.temporary().c_str(), "wb"));
  if (!stream) file.fail(std::strerror(errno));
  if (const int reason = encode_into(stream.get(), encode)) file.fail(std::strerror(reason));
  if (std::fclose(stream.release()) != 0) file.fail(std::strerror(errno));
  file.commit();
}

}  // namespace malus::internal
