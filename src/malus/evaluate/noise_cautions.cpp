#include "malus/evaluate/noise_cautions.h"

#include "malus/base/text.h"
#include "malus/base/wording.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

// Of one channel.
struct LineSums {
  double count = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
  void add(double clean, double frame) {
    ++count;
    x += clean, y += frame;
    xx += clean * clean, xy += clean * frame, yy += frame * frame;
  }
  double about_means(double product, double one, double other) const {
    return count > 0 ? product - one * other / count : 0;
  }
};

bool is_other_light(const std::optional<double>& light) {
  constexpr double kMuch = 1.25;
  return light && (*light >= kMuch || *light <= 1 / kMuch);
}

std::string light_caution(const char* side, double light) {
  return fmt::format(
      "the {} {:.3g} times the light of {}, and the difference counts as noise: give the scene at "
      "the light of the frames, divided by their low-light ratio",
      side, light, setting("clean"));
}

// Shading and fixed pattern of one side alone are no noise, and were most of the distance.
std::string pattern_caution(const NoiseComparison& comparison,
                            const NoiseComparisonSettings& settings) {
  constexpr double kOfVariance = 0.1;
  const double reference = comparison.reference.between_frames,
               test = comparison.test.between_frames;
  if (settings.remove_fixed_pattern || !(std::abs(reference - test) > kOfVariance)) return "";
  return fmt::format(
      "{} % of the variance of the {} is alike from frame to frame, shading or a fixed pattern "
      "that the {} have not: {} compares the temporal noise",
      percent_text(std::max(reference, test)), reference > test ? "reference" : "tests",
      reference > test ? "tests" : "reference", setting("remove_fixed_pattern", true));
}

}  // namespace

Estimate<double> light_over_clean(View<const float> frame_dn, View<const float> clean_dn,
                                  const SensorLayout& layout) {
  MALUS_REQUIRE(frame_dn.rows() == clean_dn.rows() && frame_dn.cols() == clean_dn.cols());
  constexpr double kAboveNoise = 10;
  std::vector<LineSums> channels(static_cast<std::size_t>(layout.channels()));
  for (int r = 0; r < clean_dn.rows(); ++r)
    for (int c = 0; c < clean_dn.cols(); ++c) {
      const double clean = clean_dn(r, c), frame = frame_dn(r, c);
      if (!std::isfinite(clean) || !std::isfinite(frame)) continue;
      channels[static_cast<std::size_t>(layout.channel_at(r, c))].add(clean, frame);
    }
  double xx = 0, xy = 0, yy = 0;
  for (const LineSums& sums : channels) {
    xx += sums.about_means(sums.xx, sums.x, sums.x);
    xy += sums.about_means(sums.xy, sums.x, sums.y);
    yy += sums.about_means(sums.yy, sums.y, sums.y);
  }
  const double slope = xx > 0 ? xy / xx : 0, about_line = yy - slope * xy;
  if (!(std::max(slope * xy, xx) > kAboveNoise * about_line))
    return Undecided{"the light of the scene varies less than the noise"};
  return slope;
}

std::vector<std::string> cautions_of(const NoiseComparison& comparison,
                                     const NoiseComparisonSettings& settings) {
  std::vector<std::string> lines;
  if (is_other_light(comparison.reference_light))
    lines.push_back(light_caution("reference shows", *comparison.reference_light));
  if (is_other_light(comparison.test_light))
    lines.push_back(light_caution("tests show", *comparison.test_light));
  if (!lines.empty()) return lines;  // what the frames have in common is this
  if (std::string line = pattern_caution(comparison, settings); !line.empty())
    lines.push_back(std::move(line));
  return lines;
}

}  // namespace malus
