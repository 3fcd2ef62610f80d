#include "malus/io/internal/tiff_inflate.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/unreadable_file.h"
#include "malus/io/internal/tiff_file.h"

#include <algorithm>
#include <new>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <unistd.h>
#include <zlib.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

// A strip or a tile: where it lies, and how many bytes of pixels it has to hold.
struct DeflatedBlock {
  std::uint64_t at, bytes;
  std::uint64_t least, most;  // inflated
};

std::uint64_t blocks_over(std::uint64_t length, std::uint64_t block) {
  return (length + block - 1) / block;
}

// None of a directory that makes no sense: libtiff refuses those.
std::vector<DeflatedBlock> blocks_of(const TiffFile& file, const TiffTags& tags) {
  constexpr std::uint64_t kSeparate = 2, kYCbCr = 6;
  const std::uint64_t rows = tags.one(kRows, 0), cols = tags.one(kCols, 0),
                      samples = tags.one(kSamples, 1);
  const bool separate = tags.one(kPlanar, 1) == kSeparate, tiled = tags.has(kTilePlaces);
  const std::uint64_t block_rows =
      tiled ? tags.one(kTileRows, 0) : std::min(rows, tags.one(kRowsPerStrip, rows));
  const std::uint64_t block_cols = tiled ? tags.one(kTileCols, 0) : cols;
  if (rows == 0 || cols == 0 || block_rows == 0 || block_cols == 0) return {};
  const std::uint64_t down = blocks_over(rows, block_rows);
  const std::uint64_t count = down * blocks_over(cols, block_cols) * (separate ? samples : 1);
  const auto places = tags.all(tiled ? kTilePlaces : kStripPlaces, count),
             sizes = tags.all(tiled ? kTileBytes : kStripBytes, count);
  const std::uint64_t row_bytes =
      blocks_over(block_cols * (separate ? 1 : samples) * tags.one(kBits, 1), 8);
  // Colours at half of the resolution: how many bytes that makes is libtiff's to know.
  const bool subsampled = tags.one(kPhotometric, 0) == kYCbCr;
  std::vector<DeflatedBlock> blocks;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const bool last = !tiled && (i + 1) % down == 0;
    const std::uint64_t held = last ? rows - (down - 1) * block_rows : block_rows;
    // Without a size: what is left of the file.
    const std::uint64_t left = places[i] < file.file_bytes ? file.file_bytes - places[i] : 0;
    const std::uint64_t bytes = i < sizes.size() && sizes[i] > 0 ? std::min(sizes[i], left) : left;
    blocks.push_back({places[i], bytes, subsampled ? 0 : held * row_bytes,
                      subsampled ? UINT64_MAX : block_rows * row_bytes});
  }
  return blocks;
}

// Inflates one block after the other, into nothing.
class Inflation {
 public:
  explicit Inflation(int file) : file_(file), in_(kBuffer), out_(kBuffer) {
    if (inflateInit(&stream_) != Z_OK) throw std::bad_alloc();
  }
  ~Inflation() { inflateEnd(&stream_); }
  Inflation(const Inflation&) = delete;
  Inflation& operator=(const Inflation&) = delete;

  // What is wrong with it; empty where nothing is.
  std::string damage_in(DeflatedBlock block) {
    inflateReset(&stream_);
    stream_.avail_in = 0;
    for (int status = Z_OK; status != Z_STREAM_END;) {
      if (stream_.avail_in == 0 && !fill(block)) return "it ends too early";
      stream_.next_out = out_.data();
      stream_.avail_out = static_cast<uInt>(out_.size());
      status = inflate(&stream_, Z_NO_FLUSH);
      if (status == Z_MEM_ERROR) throw std::bad_alloc();
      if (status != Z_OK && status != Z_STREAM_END)
        return stream_.msg ? stream_.msg : "it is no Deflate stream";
      if (stream_.total_out > block.most) return "it holds more than its pixels";
    }
    return stream_.total_out < block.least ? "it holds less than its pixels" : "";
  }

 private:
  static constexpr std::size_t kBuffer = std::size_t{1} << 16;

  bool fill(DeflatedBlock& block) {
    const auto wanted = static_cast<std::size_t>(std::min<std::uint64_t>(block.bytes, kBuffer));
    const ssize_t read = ::pread(file_, in_.data(), wanted, static_cast<off_t>(block.at));
    if (read <= 0) return false;
    block.at += static_cast<std::uint64_t>(read);
    block.bytes -= static_cast<std::uint64_t>(read);
    stream_.next_in = in_.data();
    stream_.avail_in = static_cast<uInt>(read);
    return true;
  }

  int file_;
  z_stream stream_{};
  std::vector<Bytef> in_, out_;
};

}  // namespace

void check_deflated(const fs::path& path, std::uintmax_t file_bytes, std::uint64_t directory) {
  constexpr std::uint64_t kDeflate = 8, kOldDeflate = 32946;
  const TiffFile file = tiff_file(path, file_bytes);
  const TiffTags tags(file, directory, "directory");
  const std::uint64_t compression = tags.one(kCompression, 1);
  if (compression != kDeflate && compression != kOldDeflate) return;
  const std::vector<DeflatedBlock> blocks = blocks_of(file, tags);
  const OpenFile opened(std::fopen(path.c_str(), "rb"));
  if (!opened) throw unreadable_file(path);
  const int descriptor = ::fileno(opened.get());
  constexpr std::ptrdiff_t kPieces = 64;
  const auto count = static_cast<std::ptrdiff_t>(blocks.size());
  const std::string damage = parallel_reduce(
      0, count, (count + kPieces - 1) / kPieces + (count == 0), std::string(),
      [&](std::ptrdiff_t first, std::ptrdiff_t end) {
        Inflation inflation(descriptor);
        for (std::ptrdiff_t i = first; i < end; ++i)
          if (const std::string found = inflation.damage_in(blocks[static_cast<std::size_t>(i)]);
              !found.empty())
            return fmt::format("{} {} of {} is damaged ({})",
                               tags.has(kTilePlaces) ? "tile" : "strip", i + 1, count, found);
        return std::string();
      },
      [](const std::string& before, const std::string& next) {
        return before.empty() ? next : before;
      });
  if (!damage.empty())
    throw InputError(path.string(), "cannot be decoded: " + damage,
                     "the file is damaged or cut off: copy or record it again");
}

}  // namespace malus::internal
