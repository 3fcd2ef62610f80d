// Likeness of neighbouring pixels' temporal noise.
#include "malus/calibrate/internal/neighbour_correlation.h"

#include "malus/base/statistics.h"
#include "malus/noise/two_outputs.h"

#include <cmath>

#include "simulated_session.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// White noise of 1 DN over a fixed pattern and light that falls to one side; every row and column
// of a frame has an offset of line_dn besides, shared by two rows.
Image noisy_frame(int size, std::uint64_t frame, double light_dn, double line_dn) {
  const auto normal = [frame](int r, int c, std::uint32_t stream) {
    return testing::internal::normal_at(
        frame, static_cast<std::uint64_t>(r) << 32 | static_cast<std::uint64_t>(c), stream);
  };
  Image out(size, size);
  for (int r = 0; r < size; ++r)
    for (int c = 0; c < size; ++c)
      out(r, c) = static_cast<float>(
          100 + 3 * std::sin(0.7 * r * c) + light_dn * (1 - 0.5 * r * c / (size * size)) +
          normal(r, c, 5) + line_dn * (normal(r / 2, 0, 6) + normal(0, c, 7)));
  return out;
}

NeighbourCorrelation of_frames(const MosaicGeometry& geometry, std::uint64_t first, int frames,
                               double flicker, double line_dn) {
  NeighbourCorrelation sums(geometry);
  const std::vector<double> dark(static_cast<std::size_t>(geometry.channels()), 100.0);
  FramePairs pairs(sums, flicker > 0 ? dark : std::vector<double>(), frames / 2);
  for (int i = 0; i < frames; ++i)
    pairs.add(noisy_frame(geometry.rows(), first + static_cast<std::uint64_t>(i),
                          flicker > 0 ? 500 * (1 + flicker * (i % 2)) : 0, line_dn));
  return sums;
}

// Eight frames whose pixels, but for the outer rows and `outer_cols` outer columns, are
// filtered(frame, row, column) of a frame of white noise.
template <class Filtered>
NeighbourCorrelation of_filtered(const MosaicGeometry& geometry, int outer_cols,
                                 const Filtered& filtered) {
  NeighbourCorrelation sums(geometry);
  FramePairs pairs(sums, {}, 4);
  for (std::uint64_t i = 0; i < 8; ++i) {
    const Image sharp = noisy_frame(geometry.rows(), i, 0, 0);
    Image frame = sharp;
    for (int r = 1; r + 1 < geometry.rows(); ++r)
      for (int c = outer_cols; c < geometry.cols() - outer_cols; ++c)
        frame(r, c) = filtered(sharp, r, c);
    pairs.add(frame);
  }
  return sums;
}

// 300 sets of four frames, of channels of 8 x 8 and of 32 x 32 pixels: their correlations are 0
// within their standard errors, whatever rows and columns share and the lamp does. Four standard
// errors of the mean and of the mean square (level 1e-4 each).
TEST(NeighbourCorrelation, OfWhiteNoiseIsNoneWithinItsStandardError) {
  for (const char* layout : {"mono", "polar-bayer-rggb"})
    for (const double flicker : {0.0, 0.03}) {
      const MosaicGeometry geometry(SensorLayout::named(layout), 32, 32, 1);
      Moments deviations;
      double squares = 0;
      for (std::uint64_t set = 0; set < 300; ++set)
        for (const NeighbourLikeness& one :
             of_frames(geometry, 4 * set, 4, flicker, 2.0).likeness()) {
          deviations.add(one.correlation / one.standard_error);
          squares += std::pow(one.correlation / one.standard_error, 2);
        }
      const auto count = static_cast<double>(deviations.count());
      EXPECT_NEAR(deviations.mean(), 0, 4 / std::sqrt(count)) << layout << flicker;
      EXPECT_NEAR(squares / count, 1, 4 * std::sqrt(2 / count) + 0.1) << layout << flicker;
    }
}

// Less than once in 1000 sets of four frames of 128 x 128 pixels: five standard errors.
TEST(NeighbourCorrelation, WhiteNoiseOfFourFramesIsNotWarnedOf) {
  const MosaicGeometry geometry(SensorLayout::named("mono"), 128, 128, 1);
  for (std::uint64_t set = 0; set < 40; ++set) {
    PhysicsCalibration out;
    const NeighbourCorrelation sums = of_frames(geometry, 4 * set, 4, 0, 1.0);
    warn_of_alike_neighbours(sums, sums, out);
    EXPECT_TRUE(out.warnings.empty()) << out.warnings.front();
    for (const NeighbourLikeness& one : sums.likeness())
      EXPECT_NEAR(one.standard_error, 1 / std::sqrt(2 * 128 * 128.0), 0.0005);
  }
}

// Columns smoothed by (1 2 1) / 4 correlate by 4 / 6 with the next pixel.
TEST(NeighbourCorrelation, OfSmoothedNoiseIsThatOfTheKernel) {
  const MosaicGeometry geometry(SensorLayout::named("mono"), 128, 128, 1);
  const NeighbourCorrelation sums = of_filtered(geometry, 0, [](const Image& sharp, int r, int c) {
    return 0.5F * sharp(r, c) + 0.25F * (sharp(r - 1, c) + sharp(r + 1, c));
  });
  const auto likeness = sums.likeness();
  EXPECT_NEAR(likeness.at(0).correlation, 0, 5 * likeness[0].standard_error);
  EXPECT_NEAR(likeness.at(1).correlation, 4.0 / 6.0, 0.02);
  PhysicsCalibration out;
  warn_of_alike_neighbours(NeighbourCorrelation(geometry), sums, out);
  ASSERT_EQ(out.warnings.size(), 1u);
  EXPECT_NE(out.warnings[0].find("in a column"), std::string::npos) << out.warnings[0];
  EXPECT_NE(out.warnings[0].find("flat frames"), std::string::npos) << out.warnings[0];
}

// One per cent of a pixel in each of its four neighbours takes 7.7 % off K; not a word was said.
TEST(NeighbourCorrelation, OfCoupledPixelsIsToldWithWhatItTakesOffK) {
  const MosaicGeometry geometry(SensorLayout::named("mono"), 130, 130, 1);
  const auto flats = [&](float share) {
    return of_filtered(geometry, 1, [share](const Image& sharp, int r, int c) {
      return (1 - 4 * share) * sharp(r, c) +
             share * (sharp(r - 1, c) + sharp(r + 1, c) + sharp(r, c - 1) + sharp(r, c + 1));
    });
  };
  const auto told = [&](const NeighbourCorrelation& dark, const NeighbourCorrelation& flat) {
    PhysicsCalibration out;
    out.K.mean = {0.4};
    warn_of_alike_neighbours(dark, flat, out);
    return out.warnings.empty() ? std::string() : out.warnings.front();
  };
  const NeighbourCorrelation none(geometry), coupled = flats(0.01F);
  EXPECT_EQ(told(none, flats(0)), "");
  const std::string said = told(none, coupled);
  EXPECT_NE(said.find("pixels share signal"), std::string::npos) << said;
  const std::size_t at = said.find("is about ");
  ASSERT_NE(at, std::string::npos) << said;
  EXPECT_NEAR(std::stod(said.substr(at + 9)), 7.7, 2.5) << said;
  // The noise of a read-out amplifier in dim flats is none of it.
  NeighbourCorrelation dim = coupled;
  dim.hold_dark_share(0.9);
  EXPECT_EQ(told(coupled, dim), "");
}

// Eight frames of white noise, whose rows have offsets of 1 DN: of their own in each half, along
// all of the row, or growing along it.
enum class RowOffsets { kHalves, kWhole, kGrowing };
NeighbourCorrelation of_rows(const MosaicGeometry& geometry, RowOffsets offsets) {
  NeighbourCorrelation sums(geometry);
  FramePairs pairs(sums, {}, 4);
  for (std::uint64_t i = 0; i < 8; ++i) {
    Image frame = noisy_frame(geometry.rows(), i, 0, 0);
    for (int r = 0; r < frame.rows(); ++r)
      for (int c = 0; c < frame.cols(); ++c) {
        const bool right = 2 * c >= frame.cols();
        const double weight = offsets == RowOffsets::kGrowing ? 3.5 * c / frame.cols() - 1.75 : 1;
        frame(r, c) += static_cast<float>(
            weight * testing::internal::normal_at(
                         i,
                         static_cast<std::uint64_t>(r) << 1 |
                             static_cast<std::uint64_t>(offsets == RowOffsets::kHalves && right),
                         9));
      }
    pairs.add(frame);
  }
  return sums;
}

// Two outputs: half of their variance is that of the row, and half of 1.5 DN² of the rest shared.
TEST(NeighbourCorrelation, HalvesOfRowsWithNoiseOfTheirOwnAreTold) {
  for (const char* layout : {"mono", "polar-mono"}) {
    const MosaicGeometry geometry(SensorLayout::named(layout), 96, 96, 1);
    const NeighbourCorrelation halves = of_rows(geometry, RowOffsets::kHalves);
    EXPECT_NEAR(halves.shared_by_halves(), 1.0 / 3, 0.06) << layout;
    for (const NeighbourLikeness& one : halves.likeness())
      EXPECT_NEAR(one.correlation, 0, 0.05) << layout << one.where;
    PhysicsCalibration p;
    p.temporal_sd_dark_dn = {std::sqrt(2.0)};
    p.sigma_row.mean = {std::sqrt(0.5)};
    warn_of_alike_neighbours(halves, NeighbourCorrelation(geometry), p);
    ASSERT_EQ(p.warnings.size(), 1u);
    EXPECT_NE(p.warnings[0].find("two outputs"), std::string::npos) << p.warnings[0];
    EXPECT_TRUE(p.warnings[0].starts_with(kTwoOutputsFinding)) << "denoise looks for it";
    EXPECT_NE(p.warnings[0].find("0.7"), std::string::npos) << p.warnings[0];
    for (const RowOffsets other : {RowOffsets::kWhole, RowOffsets::kGrowing})
      EXPECT_EQ(of_rows(geometry, other).shared_by_halves(), 0) << layout;
    const NeighbourCorrelation smoothed =
        of_filtered(geometry, 2, [](const Image& sharp, int r, int c) {
          return 0.25F * (sharp(r, c - 2) + sharp(r, c - 1) + sharp(r, c) + sharp(r, c + 1));
        });
    EXPECT_EQ(smoothed.shared_by_halves(), 0) << layout;
  }
}

}  // namespace
}  // namespace malus
