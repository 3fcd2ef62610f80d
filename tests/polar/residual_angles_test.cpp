// What residual demosaicking is made of: windows, and bands of a picture.
#include "malus/polar/internal/residual_angles.h"

#include "malus/base/random.h"
#include "malus/polar/demosaick.h"
#include "malus/polar/internal/lattice.h"

#include <algorithm>
#include <cmath>
#include <tuple>

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(BoxMean, EqualsItsDefinitionAtEveryBorder) {
  RandomSequence random(8, 0, Draw::kOther);
  for (const auto& [rows, cols, radius] :
       {std::tuple{1, 1, 2}, {3, 70, 5}, {70, 3, 1}, {70, 40, 3}}) {
    Image image(rows, cols);
    for (float& v : image.values()) v = static_cast<float>(random.normal());
    const Image mean = internal::box_mean(image, radius);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < cols; ++c) {
        double sum = 0;
        int count = 0;
        for (int i = std::max(0, r - radius); i <= std::min(rows - 1, r + radius); ++i)
          for (int j = std::max(0, c - radius); j <= std::min(cols - 1, c + radius); ++j)
            sum += image(i, j), ++count;
        ASSERT_NEAR(mean(r, c), sum / count, 1e-6) << rows << ' ' << r << ' ' << c;
      }
  }
}

// Light over six decades: sums that depended on where a band begins would show.
TEST(ResidualAngles, ABandGivesTheBitsOfTheWhole) {
  constexpr int kRows = 300, kCols = 40, kFirst = 100, kLast = 220;
  const SensorLayout layout = SensorLayout::named("polar-mono");
  RandomSequence random(4, 0, Draw::kScene, 0);
  Image whole(kRows, kCols), band(kLast - kFirst, kCols);
  for (float& v : whole.values()) v = static_cast<float>(std::pow(10.0, 6 * random.uniform() - 3));
  std::copy(whole.row(kFirst), whole.row(kLast - 1) + kCols, band.values().begin());
  constexpr double kEpsilon = 10, kSquare = 1e5;
  const auto all = internal::residual_angles(whole, layout, kEpsilon, kSquare);
  const auto part = internal::residual_angles(band, layout, kEpsilon, kSquare);
  for (int r = kFirst + internal::kAnglesReach; r < kLast - internal::kAnglesReach; ++r)
    for (int c = 0; c < kCols; ++c) {
      ASSERT_EQ(part.stokes.s0(r - kFirst, c), all.stokes.s0(r, c)) << r;
      ASSERT_EQ(part.stokes.s1(r - kFirst, c), all.stokes.s1(r, c)) << r;
      ASSERT_EQ(part.stokes.s2(r - kFirst, c), all.stokes.s2(r, c)) << r;
      ASSERT_EQ(part.s0_takes_part(r - kFirst, c), all.s0_takes_part(r, c)) << r;
    }
}

// A picture that repeats every eight rows does so across the borders of its bands, too.
TEST(Demosaick, ResidualBandsLeaveNoSeam) {
  constexpr int kRows = 600, kCols = 24, kPeriod = 8, kFirst = 200, kLast = 400;
  for (const char* name : {"polar-mono", "polar-bayer-rggb"}) {
    RandomSequence random(5, 0, Draw::kScene, 0);
    Image mosaic(kRows, kCols);
    for (int r = 0; r < kRows; ++r)
      for (int c = 0; c < kCols; ++c)
        mosaic(r, c) = r < kPeriod ? static_cast<float>(std::pow(10.0, 4 * random.uniform()))
                                   : mosaic(r - kPeriod, c);
    const StokesPicture picture =
        demosaick(mosaic.view(), SensorLayout::named(name), Demosaicking::kResidual);
    for (const StokesPlanes& planes : picture.planes)
      for (const Image* plane : {&planes.s0, &planes.s1, &planes.s2})
        for (int r = kFirst; r < kLast; ++r)
          for (int c = 0; c < kCols; ++c)
            ASSERT_EQ((*plane)(r, c), (*plane)(kFirst + r % kPeriod, c)) << name << ' ' << r;
  }
}

}  // namespace
}  // namespace malus
