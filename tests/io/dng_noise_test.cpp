// NoiseProfile tags in both byte orders and in sub-directories; damage is refused.
#include "malus/io/dng_noise.h"

#include "malus/base/error.h"

#include <bit>
#include <cstdint>
#include <filesystem>
#include <fstream>

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

// A TIFF whose directory at byte 8 has one entry, then `extra` at byte 26.
class TinyTiff {
 public:
  explicit TinyTiff(bool big) : big_(big) {
    bytes_ = big ? "MM" : "II";
    put(42, 2);
    put(8, 4);
  }
  TinyTiff& put(std::uint64_t value, int count) {
    for (int i = 0; i < count; ++i)
      bytes_ += static_cast<char>(value >> 8 * (big_ ? count - 1 - i : i) & 0xFF);
    return *this;
  }
  TinyTiff& entry(int tag, int type, std::uint32_t count, std::uint32_t value) {
    return put(1, 2)
        .put(static_cast<std::uint64_t>(tag), 2)
        .put(static_cast<std::uint64_t>(type), 2)
        .put(count, 4)
        .put(value, 4)
        .put(0, 4);
  }
  TinyTiff& real(double value) { return put(std::bit_cast<std::uint64_t>(value), 8); }
  std::string bytes() const { return bytes_; }

 private:
  bool big_;
  std::string bytes_;
};

class DngNoise : public ::testing::Test {
 protected:
  DngNoiseProfile read(const std::string& bytes) {
    const std::filesystem::path path = folder_ / "noise.dng";
    std::ofstream(path, std::ios::binary) << bytes;
    return read_dng_noise_profile(path);
  }

 private:
  testing::TemporaryFolder folder_;
};

TEST_F(DngNoise, BothByteOrders) {
  for (const bool big : {false, true}) {
    const auto file = TinyTiff(big).entry(51041, 12, 2, 26).real(2.5e-4).real(-1e-7).bytes();
    const DngNoiseProfile profile = read(file);
    EXPECT_EQ(profile.slope, std::vector<double>{2.5e-4});
    EXPECT_EQ(profile.offset, std::vector<double>{-1e-7});
  }
}

TEST_F(DngNoise, ThreePlanesInASubDirectory) {
  TinyTiff file(false);
  file.entry(330, 4, 1, 26).entry(51041, 12, 6, 44);
  for (const double v : {1e-3, 1e-6, 2e-3, 2e-6, 3e-3, 3e-6}) file.real(v);
  const DngNoiseProfile profile = read(file.bytes());
  EXPECT_EQ(profile.slope, (std::vector<double>{1e-3, 2e-3, 3e-3}));
  EXPECT_EQ(profile.offset, (std::vector<double>{1e-6, 2e-6, 3e-6}));
}

TEST_F(DngNoise, DamageIsRefused) {
  const auto good = TinyTiff(false).entry(51041, 12, 2, 26).real(1e-4).real(1e-7).bytes();
  for (std::size_t length = 0; length < good.size(); ++length)
    EXPECT_THROW(read(good.substr(0, length)), InputError) << length;
  EXPECT_THROW(read(TinyTiff(false).entry(51041, 12, 3, 26).real(1).real(1).bytes()), InputError);
  EXPECT_THROW(read(TinyTiff(false).entry(51041, 12, 2, 26).real(-1).real(1).bytes()), InputError);
  EXPECT_THROW(read(TinyTiff(false).entry(256, 3, 1, 5).bytes()), InputError);
  // A directory that names itself.
  EXPECT_THROW(read(TinyTiff(false).entry(330, 4, 1, 8).bytes()), InputError);
}

TEST_F(DngNoise, FilesThatAreNotThereAreNotCalledDamaged) {
  EXPECT_THAT([] { read_dng_noise_profile("/nowhere/frame.dng"); },
              ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("does not exist")));
  EXPECT_THAT([] { read_dng_noise_profile("/"); },
              ::testing::ThrowsMessage<InputError>(::testing::HasSubstr("is a folder")));
}

}  // namespace
}  // namespace malus
