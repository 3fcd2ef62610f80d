// The figures that docs/bm3d.md states, on the twelve pictures they are stated for.
#include "malus/base/random.h"
#include "malus/denoise/bm3d.h"
#include "malus/io/picture_file.h"

#include <cmath>
#include <string>

#include "support.h"
#include <fmt/format.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

struct Quality {
  double psnr_db = 0, predicted_over_actual = 0;
};

Quality set12(const std::string& profile, float sigma) {
  Quality quality;
  double predicted = 0, actual = 0;
  for (std::uint32_t i = 1; i <= 12; ++i) {
    const Image clean =
        load_picture(testing::shared_data() / "set12" / fmt::format("{:02}.png", i)).planes[0];
    Planes noisy(1, clean.rows(), clean.cols()), variance;
    RandomSequence random(1, i, Draw::kOther);
    for (std::size_t p = 0; p < clean.size(); ++p)
      noisy[0].values()[p] = clean.values()[p] + sigma * static_cast<float>(random.normal());
    const Planes result =
        bm3d(noisy, std::span(&sigma, 1), {.profile = profile}, {}, silent_progress(), &variance);
    double squares = 0;
    for (std::size_t p = 0; p < clean.size(); ++p) {
      const double d = double{result[0].values()[p]} - double{clean.values()[p]};
      squares += d * d;
      predicted += double{variance[0].values()[p]};
    }
    actual += squares;
    quality.psnr_db +=
        10 * std::log10(255 * 255 * static_cast<double>(clean.size()) / squares) / 12;
  }
  quality.predicted_over_actual = predicted / actual;
  return quality;
}

TEST(Bm3dQuality, NormalReachesThePublishedReference) {
  MALUS_NEEDS_SHARED("set12/12.png");
  const Quality low = set12("normal", 25), high = set12("normal", 50);
  EXPECT_GE(low.psnr_db, 29.95);
  EXPECT_GE(high.psnr_db, 26.70);
  EXPECT_NEAR(low.predicted_over_actual, 1, 0.35);
  EXPECT_NEAR(high.predicted_over_actual, 1, 0.35);
}

TEST(Bm3dQuality, FastKeepsMostOfIt) {
  MALUS_NEEDS_SHARED("set12/12.png");
  EXPECT_GE(set12("fast", 25).psnr_db, 29.3);
  EXPECT_GE(set12("fast", 50).psnr_db, 25.9);
}

}  // namespace
}  // namespace malus
