#include "malus/calibrate/internal/defects.h"

#include "malus/base/chi_square.h"
#include "malus/base/index.h"
#include "malus/calibrate/internal/pixel_location.h"
#include "malus/image/window.h"
#include "malus/noise/smooth_map.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <utility>

namespace malus {
namespace {

// Chances that the heaviest of some values alone explains what they show: of a heavy-tailed sum the
// tail is that of its largest term (Chistyakov, Theory Probab. Appl. 9, 1964). No variance of a
// variance serves here: below λ = -1/4 there is none.
class SingleValue {
 public:
  explicit SingleValue(const ReadTail& tail) : tail_(tail) {}
  /// Of a mean this far above the others' or farther.
  double above_mean(double difference_dn, int frames) const {
    return beyond(difference_dn * frames, frames);
  }
  /// Of a sum of squares this far above the others' or farther; the pixel's own mean moves along.
  double above_squares(double difference_dn2, int frames) const {
    return 2.0 * beyond(std::sqrt(std::max(difference_dn2, 0.0) / (1.0 - 1.0 / frames)), frames);
  }

 private:
  double beyond(double value_dn, int frames) const {
    return tail_.scale_dn > 0 ? frames * tukey_lambda_cdf(-value_dn / tail_.scale_dn, tail_.lambda)
                              : 0.0;
  }
  ReadTail tail_;
};

// What a pixel shows over its frames, about the usual level of its channel.
struct PixelOfFrames {
  double above_dn = 0, squares_dn2 = 0;
  int frames = 0;

  // Of the other frames.
  PixelOfFrames without(double value_above_mean_dn) const {
    const double n = frames, v = value_above_mean_dn;
    return {above_dn - v / (n - 1.0), std::max(squares_dn2 - v * v * n / (n - 1.0), 0.0),
            frames - 1};
  }
};

// What a channel's ordinary pixels show in the dark.
struct UsualPixel {
  PixelLocation level;
  double variance_dn2;   // of the median sum of squares
  bool constancy_tells;  // a pixel that never changes is none of them

  double deviations_hot(const PixelOfFrames& pixel) const {
    return level.deviation > 0 ? pixel.above_dn / level.deviation : 0.0;
  }
  double variance_ratio(const PixelOfFrames& pixel) const {
    return variance_dn2 > 0 ? pixel.squares_dn2 / (pixel.frames - 1.0) / variance_dn2 : 1.0;
  }
  double deviations_noisy(const PixelOfFrames& pixel) const {
    return pixel.frames >= 2 ? chi_square_deviate(variance_ratio(pixel), pixel.frames - 1.0) : 0.0;
  }
};

UsualPixel usual_pixel(const DarkPixels& dark, const MosaicGeometry& geometry, int channel,
                       double chance) {
  const double squares = median_of(enough_of(
      geometry, channel, [&](int r, int c) { return double{dark.sum_of_squares(r, c)}; }));
  UsualPixel usual{
      location_of(geometry, channel, [&](int r, int c) { return dark.shading_dn(r, c); }),
      squares / (dark.frames - 1.0), dark.constancy[as_index(channel)] < chance};
  if (usual.constancy_tells) return usual;
  usual.level.deviation = std::max(usual.level.deviation, least_shown_deviation(dark.step_dn));
  // A mean between two codes gives half of the values either.
  usual.variance_dn2 = std::max(usual.variance_dn2, dark.step_dn * dark.step_dn / 4.0);
  return usual;
}

// Judges the pixels of one channel.
class DefectTest {
 public:
  DefectTest(const DarkPixels& dark, const MosaicGeometry& geometry, int channel)
      : dark_(dark),
        chance_(kExpectedByChance / static_cast<double>(geometry.channel_pixels(channel))),
        usual_(usual_pixel(dark, geometry, channel, chance_)),
        single_(dark.tails.empty() ? ReadTail() : dark.tails[as_index(channel)]) {}

  PixelOfFrames pixel(int r, int c) const {
    return {dark_.shading_dn(r, c) - usual_.level.centre, dark_.sum_of_squares(r, c), dark_.frames};
  }
  bool constant(const PixelOfFrames& pixel) const {
    return dark_.frames >= kStuckNeedsFrames && usual_.constancy_tells &&
           usual_.variance_ratio(pixel) < kStuckRatio;
  }
  bool hot(const PixelOfFrames& pixel, const PixelOfFrames& rest) const {
    return usual_.deviations_hot(pixel) > kDefectDeviations &&
           usual_.deviations_hot(rest) > kOfTheRest &&
           !by_chance(single_.above_mean(rest.above_dn, rest.frames), pixel, rest);
  }
  bool noisy(const PixelOfFrames& pixel, const PixelOfFrames& rest) const {
    const double excess_dn2 = rest.squares_dn2 - usual_.variance_dn2 * (rest.frames - 1.0);
    return usual_.deviations_noisy(pixel) > kDefectDeviations &&
           usual_.variance_ratio(pixel) > kNoisyRatio &&
           usual_.deviations_noisy(rest) > kOfTheRest &&
           !by_chance(single_.above_squares(excess_dn2, rest.frames), pixel, rest);
  }
  const UsualPixel& usual() const { return usual_; }

 private:
  // Whether heavy values explain the rest. Where that leaves out the farthest one, two of them lie
  // this far out: of independent values with half the square of the chance of one.
  bool by_chance(double single, const PixelOfFrames& pixel, const PixelOfFrames& rest) const {
    return (rest.frames < pixel.frames ? single * single / 2.0 : single) >= chance_;
  }

  static constexpr double kNoisyRatio = 4.0;
  static constexpr double kExpectedByChance = 0.05;  // of all the channel's pixels
  // Of 20 frames of t-distributed noise (5 degrees of freedom) 1 of 1000 pixels stands out, and 3
  // of 100,000 do so without their farthest value; a pixel of five times the noise always does.
  static constexpr double kOfTheRest = 6.0;
  // Aligning the frames' means moves even a pixel that never changes a little.
  static constexpr double kStuckRatio = 0.02;
  static constexpr int kStuckNeedsFrames = 20;

  const DarkPixels& dark_;
  double chance_;
  UsualPixel usual_;
  SingleValue single_;
};

// Looks pixels up that come in the order of the list.
class FarthestLookup {
 public:
  explicit FarthestLookup(const std::vector<FarthestValue>& values) : values_(values) {}
  const FarthestValue* find(int row, int col) {
    if (next_ == values_.size() || values_[next_].row != row || values_[next_].col != col)
      return nullptr;
    return &values_[next_++];
  }

 private:
  const std::vector<FarthestValue>& values_;
  std::size_t next_ = 0;
};

// Larger for worse ones.
double badness(const DefectPixel& defect) {
  return defect.kind == "hot" || defect.kind == "noisy" ? defect.value
                                                        : std::numeric_limits<double>::infinity();
}

// Keeps the worst, in their order.
void keep_worst(std::size_t most, std::vector<DefectPixel>& defects) {
  if (defects.size() <= most) return;
  std::vector<double> all;
  for (const DefectPixel& defect : defects) all.push_back(badness(defect));
  const auto last = all.begin() + static_cast<std::ptrdiff_t>(most - 1);
  std::nth_element(all.begin(), last, all.end(), std::greater<>());
  const double least = *last;
  auto as_bad = std::count(all.begin(), last + 1, least);  // of those, how many have room
  std::erase_if(defects, [&](const DefectPixel& defect) {
    const double own = badness(defect);
    return own < least || (own == least && as_bad-- <= 0);
  });
}

// A list that does not grow without bound while they are found.
class DefectCollector {
 public:
  explicit DefectCollector(std::size_t most) : most_(most) {}
  void add(DefectPixel defect) {
    ++found_.found;
    found_.listed.push_back(std::move(defect));
    if (found_.listed.size() >= 2 * most_) keep_worst(most_, found_.listed);
  }
  FoundDefects release() {
    keep_worst(most_, found_.listed);
    return std::move(found_);
  }

 private:
  std::size_t most_;
  FoundDefects found_;
};

}  // namespace

std::size_t most_defects(const MosaicGeometry& geometry) {
  constexpr double kShare = 2 * kManyDefects, kOfSmallFrames = 1e5, kOfAll = 1e6;
  return static_cast<std::size_t>(
      std::clamp(kShare * geometry.rows() * geometry.cols(), kOfSmallFrames, kOfAll));
}

namespace {

// The shading without what is smooth of it in channels where that is more than chance: in a glow a
// pixel is hot that stands out of those around it. Empty where there is no such channel.
Image without_glow(View<const float> shading_dn, const MosaicGeometry& geometry) {
  constexpr double kLeastSpan = 2;  // deviations of a pixel; chance makes half of one
  const SmoothMap smooth(shading_dn, geometry.cell_rows(), geometry.cell_cols(), 0);
  std::vector<bool> glows;
  std::vector<double> centre;
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const PixelLocation level =
        location_of(geometry, channel, [&](int r, int c) { return shading_dn(r, c); });
    glows.push_back(smooth.span(channel) > kLeastSpan * level.deviation && level.deviation > 0);
    centre.push_back(level.centre);
  }
  if (std::find(glows.begin(), glows.end(), true) == glows.end()) return {};
  Image out = copy_of(shading_dn);
  const Image glow = smooth.values();
  for (int r = 0; r < out.rows(); ++r)
    for (int c = 0; c < out.cols(); ++c) {
      const auto channel = as_index(geometry.channel(r, c));
      if (glows[channel]) out(r, c) -= glow(r, c) - static_cast<float>(centre[channel]);
    }
  return out;
}

}  // namespace

FoundDefects find_defects(const DarkPixels& with_glow, View<const float> response,
                          const MosaicGeometry& geometry) {
  MALUS_REQUIRE(with_glow.frames >= 2);
  constexpr double kDeadBelow = 0.5;
  const Image flat_shading_dn = without_glow(with_glow.shading_dn, geometry);
  DarkPixels dark = with_glow;
  if (!flat_shading_dn.empty()) dark.shading_dn = flat_shading_dn;
  DefectCollector defects(most_defects(geometry));
  FarthestLookup farthest(dark.farthest);
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const DefectTest test(dark, geometry, channel);
    for_channel(geometry, channel, [&](int, int, int r, int c) {
      const PixelOfFrames pixel = test.pixel(r, c);
      const FarthestValue* far = farthest.find(r, c);
      const PixelOfFrames rest = far ? pixel.without(far->above_mean_dn) : pixel;
      const bool dead = !response.empty() && response(r, c) < kDeadBelow;
      if (test.constant(pixel) && (dead || response.empty()))
        defects.add({r, c, "stuck", test.usual().deviations_noisy(pixel)});
      else if (dead)
        defects.add({r, c, "dead", response(r, c)});
      else if (test.hot(pixel, rest))
        defects.add({r, c, "hot", test.usual().deviations_hot(pixel)});
      else if (test.noisy(pixel, rest))
        defects.add({r, c, "noisy", test.usual().deviations_noisy(pixel)});
    });
  }
  return defects.release();
}

Image constant_pixels(const DarkPixels& dark, const MosaicGeometry& geometry) {
  Image out;
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const DefectTest test(dark, geometry, channel);
    for_channel(geometry, channel, [&](int, int, int r, int c) {
      if (!test.constant(test.pixel(r, c))) return;
      if (out.empty()) out = Image(geometry.rows(), geometry.cols());
      out(r, c) = 1;
    });
  }
  return out;
}

FarthestValues::FarthestValues(const DarkPixels& dark, const MosaicGeometry& geometry)
    : geometry_(geometry), mean_dn_(dark.shading_dn) {
  constexpr int kNeedsFrames = 6;
  if (dark.frames < kNeedsFrames) return;
  for (const DefectPixel& pixel : find_defects(dark, {}, geometry).listed)
    values_.push_back({pixel.row, pixel.col, 0.0});
}

void FarthestValues::add(View<const float> dn, const std::vector<double>& drift_dn) {
  for (FarthestValue& far : values_) {
    const double above_mean_dn = dn(far.row, far.col) - mean_dn_(far.row, far.col) -
                                 drift_dn[as_index(geometry_.channel(far.row, far.col))];
    if (std::abs(above_mean_dn) > std::abs(far.above_mean_dn)) far.above_mean_dn = above_mean_dn;
  }
}

std::vector<double> temporal_excess_dn2(const DarkPixels& dark,
                                        const std::vector<DefectPixel>& defects,
                                        const MosaicGeometry& geometry) {
  MALUS_REQUIRE(dark.frames >= 2);
  const std::vector<double> all = channel_means(dark.sum_of_squares, geometry);
  std::vector<double> listed(all.size(), 0.0), count(all.size(), 0.0), excess;
  for (const DefectPixel& defect : defects) {
    const auto c = as_index(geometry.channel(defect.row, defect.col));
    listed[c] += dark.sum_of_squares(defect.row, defect.col);
    count[c] += 1.0;
  }
  for (std::size_t c = 0; c < all.size(); ++c) {
    const auto pixels = static_cast<double>(geometry.channel_pixels(static_cast<int>(c)));
    const double others =
        count[c] < pixels ? (all[c] * pixels - listed[c]) / (pixels - count[c]) : all[c];
    excess.push_back((all[c] - others) / (dark.frames - 1.0));
  }
  return excess;
}

}  // namespace malus
