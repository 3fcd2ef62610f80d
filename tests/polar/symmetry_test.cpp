#include "malus/polar/symmetry.h"

#include "malus/base/random.h"
#include "malus/image/pack.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

Image random_image(int rows, int cols, std::uint32_t frame) {
  RandomSequence random(3, frame, Draw::kOther);
  Image image(rows, cols);
  for (float& v : image.values()) v = static_cast<float>(random.uniform());
  return image;
}

class EverySymmetry : public ::testing::TestWithParam<SymmetryFacts> {};
INSTANTIATE_TEST_SUITE_P(Symmetry, EverySymmetry, ::testing::ValuesIn(kSymmetries),
                         [](const auto& test) {
                           std::string name(test.param.name);
                           std::erase(name, '-');
                           return name;
                         });

// A polarizer's axis is a direction in the picture. Turn the pixel that it points to and measure
// the angle again: an oracle that knows nothing of the table.
TEST_P(EverySymmetry, TurnsThePolarizersAxisWithThePicture) {
  constexpr int kSize = 41, kCentre = 20, kReach = 20;
  for (int angle_deg = 0; angle_deg < 180; angle_deg += 45) {
    Image picture(kSize, kSize);
    const double a = angle_deg * std::numbers::pi / 180;
    const int reach = angle_deg % 90 == 0 ? kReach : 28;  // whole pixels along the diagonals
    picture(kCentre - static_cast<int>(std::lround(reach * std::sin(a))),
            kCentre + static_cast<int>(std::lround(reach * std::cos(a)))) = 1;
    const Image turned = moved(picture, GetParam().symmetry);
    for (int r = 0; r < kSize; ++r)
      for (int c = 0; c < kSize; ++c)
        if (turned(r, c) > 0) {
          const long found =
              std::lround(std::atan2(kCentre - r, c - kCentre) * 180 / std::numbers::pi);
          EXPECT_EQ((found + 360) % 180, angle_after(GetParam().symmetry, angle_deg));
        }
  }
}

TEST_P(EverySymmetry, StokesOfTransformedPlanesAreTransformedStokes) {
  const Image i0 = random_image(5, 8, 0), i45 = random_image(5, 8, 1), i90 = random_image(5, 8, 2),
              i135 = random_image(5, 8, 3);
  const AnglePlanes planes{i0, i45, i90, i135};
  const AngleImages turned = transformed(planes, GetParam().symmetry);
  const StokesPlanes a = stokes_of(AnglePlanes{turned.i0, turned.i45, turned.i90, turned.i135});
  const StokesPlanes b = transformed(stokes_of(planes), GetParam().symmetry);
  for (std::size_t i = 0; i < a.s0.size(); ++i)
    EXPECT_NEAR(a.s0.values()[i], b.s0.values()[i], 1e-6);
  EXPECT_EQ(a.s1.values(), b.s1.values());
  EXPECT_EQ(a.s2.values(), b.s2.values());
}

// Light of a direction, turned with the picture, has the direction that the axis rule gives.
TEST_P(EverySymmetry, AolpFollowsTheAxis) {
  for (int angle_deg = 0; angle_deg < 180; angle_deg += 45) {
    const double twice = angle_deg * std::numbers::pi / 90;
    const StokesPlanes s{Image(2, 2, 1.0f), Image(2, 2, static_cast<float>(std::cos(twice))),
                         Image(2, 2, static_cast<float>(std::sin(twice)))};
    const float turned = aolp_deg_of(transformed(s, GetParam().symmetry))(0, 0);
    EXPECT_NEAR(std::remainder(double{turned} - angle_after(GetParam().symmetry, angle_deg), 180.0),
                0, 1e-4);
  }
}

// Where the lattice allows a symmetry, the moved mosaic, read at the shift, is the mosaic of the
// transformed scene.
TEST_P(EverySymmetry, LatticeShiftReadsTheSameLayout) {
  for (const auto& name : SensorLayout::known_names()) {
    const auto layout = SensorLayout::named(name);
    const auto shift = lattice_shift(layout, GetParam().symmetry);
    if (!shift || !layout.polarized()) continue;
    constexpr int kSize = 16;
    Image angles(kSize, kSize);
    for (int r = 0; r < kSize; ++r)
      for (int c = 0; c < kSize; ++c)
        angles(r, c) = static_cast<float>(
            angle_after(GetParam().symmetry, *layout.site(layout.channel_at(r, c)).angle_deg));
    const Image turned = moved(angles, GetParam().symmetry);
    for (int r = 0; r + shift->rows < kSize; ++r)
      for (int c = 0; c + shift->cols < kSize; ++c)
        ASSERT_EQ(turned(r + shift->rows, c + shift->cols),
                  static_cast<float>(*layout.site(layout.channel_at(r, c)).angle_deg))
            << name;
  }
}

// The known answer: what each lattice allows.
TEST(LatticeShift, TableOfTheLayouts) {
  const auto allowed = [](const char* name) {
    std::vector<std::pair<std::string, LatticeShift>> found;
    for (const auto& facts : kSymmetries)
      if (const auto shift = lattice_shift(SensorLayout::named(name), facts.symmetry))
        found.emplace_back(facts.name, *shift);
    return found;
  };
  EXPECT_EQ(allowed("mono").size(), 8u);
  EXPECT_EQ(allowed("bayer-rggb").size(), 8u);
  using Found = std::vector<std::pair<std::string, LatticeShift>>;
  EXPECT_EQ(allowed("polar-mono"), (Found{{"identity", {0, 0}},
                                          {"rotate-180", {1, 1}},
                                          {"transpose", {1, 1}},
                                          {"anti-transpose", {0, 0}}}));
  EXPECT_EQ(allowed("polar-bayer-rggb"), (Found{{"identity", {0, 0}}, {"anti-transpose", {2, 2}}}));
}

}  // namespace
}  // namespace malus
