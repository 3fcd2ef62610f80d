#include "malus/io/dng_noise.h"

#include "malus/base/error.h"
#include "malus/base/unreadable_file.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <optional>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

constexpr std::uint32_t kSubDirectories = 330, kNoiseProfile = 51041;
constexpr std::uint32_t kLong = 4, kDouble = 12, kIfd = 13;
constexpr int kMostDirectories = 64;  // a damaged file may send us in circles

// Numbers of a TIFF file in its byte order.
class TiffNumbers {
 public:
  explicit TiffNumbers(const fs::path& path) : path_(path), stream_(path, std::ios::binary) {
    if (!stream_ || fs::is_directory(path_)) throw unreadable_file(path_);
    std::array<char, 4> head{};
    stream_.read(head.data(), 4);
    const bool little = head[0] == 'I' && head[1] == 'I' && head[2] == 42 && head[3] == 0;
    const bool big = head[0] == 'M' && head[1] == 'M' && head[2] == 0 && head[3] == 42;
    if (!stream_ || !(little || big))
      throw InputError(path_.string(), "is no DNG file", "give a DNG as the camera wrote it");
    big_ = big;
  }

  std::uint64_t whole(std::uint64_t offset, int bytes) {
    std::array<unsigned char, 8> raw{};
    stream_.clear();
    stream_.seekg(static_cast<std::streamoff>(offset));
    stream_.read(reinterpret_cast<char*>(raw.data()), bytes);
    if (!stream_)
      throw InputError(path_.string(),
                       fmt::format("ends before byte {}", offset + static_cast<unsigned>(bytes)),
                       "copy the file again");
    std::uint64_t value = 0;
    for (int i = 0; i < bytes; ++i)
      value = value << 8 | raw[static_cast<std::size_t>(big_ ? i : bytes - 1 - i)];
    return value;
  }
  std::uint32_t word(std::uint64_t offset) { return static_cast<std::uint32_t>(whole(offset, 4)); }
  double real(std::uint64_t offset) { return std::bit_cast<double>(whole(offset, 8)); }

 private:
  fs::path path_;
  std::ifstream stream_;
  bool big_ = false;
};

std::optional<DngNoiseProfile> profile_at(TiffNumbers& file, std::uint32_t count,
                                          std::uint32_t offset) {
  if (count != 2 && count != 6) return std::nullopt;  // one or three pairs
  DngNoiseProfile profile;
  for (std::uint32_t i = 0; i < count; i += 2) {
    profile.slope.push_back(file.real(std::uint64_t{offset} + 8u * i));
    profile.offset.push_back(file.real(std::uint64_t{offset} + 8u * i + 8u));
    if (!(profile.slope.back() >= 0 && std::isfinite(profile.slope.back()) &&
          std::isfinite(profile.offset.back())))
      return std::nullopt;
  }
  return profile;
}

}  // namespace

DngNoiseProfile read_dng_noise_profile(const fs::path& path) {
  TiffNumbers file(path);
  std::vector<std::uint32_t> directories{file.word(4)};
  for (std::size_t d = 0; d < directories.size() && d < kMostDirectories; ++d) {
    const std::uint64_t start = directories[d];
    if (start == 0) continue;
    const auto entries = static_cast<std::uint32_t>(file.whole(start, 2));
    for (std::uint32_t e = 0; e < entries; ++e) {
      const std::uint64_t entry = start + 2 + 12u * e;
      const auto tag = static_cast<std::uint32_t>(file.whole(entry, 2));
      const auto type = static_cast<std::uint32_t>(file.whole(entry + 2, 2));
      const std::uint32_t count = file.word(entry + 4), value = file.word(entry + 8);
      if (tag == kNoiseProfile && type == kDouble) {
        if (auto profile = profile_at(file, count, value)) return *profile;
        throw InputError(path.string(),
                         fmt::format("has a NoiseProfile of {} numbers that is none", count),
                         "calibrate the camera instead");
      }
      if (tag != kSubDirectories || (type != kLong && type != kIfd)) continue;
      for (std::uint32_t i = 0; i < count && directories.size() < kMostDirectories; ++i)
        directories.push_back(count == 1 ? value : file.word(std::uint64_t{value} + 4u * i));
    }
    directories.push_back(file.word(start + 2 + 12u * entries));
  }
  throw InputError(path.string(), "holds no NoiseProfile",
                   "give a DNG that has one, or calibrate the camera");
}

}  // namespace malus
