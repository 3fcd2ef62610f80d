#include "malus/calibrate/internal/flat_level.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/lamp_flicker.h"
#include "malus/calibrate/internal/light_profile.h"
#include "malus/image/quantization.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <set>
#include <utility>

namespace malus {
namespace {

// Below this share of the range light adds so little that a drifting black level would be mistaken
// for a flickering lamp.
constexpr double kLampShare = 0.05;
constexpr int kPairsPerLevel = 2;  // of frames, to compare neighbours

// Pixels that are defects without light are left out of the count of saturated ones, of which a
// small frame bears no single one; those that are saturated are kept apart.
void count_bright(const GainRun& run, const RawFrame& frame, const MatchingDark& dark,
                  std::set<std::pair<int, int>>& filled, FlatLevel& level) {
  const MosaicGeometry& geometry = run.geometry();
  const double white_dn = run.format().white_dn;
  const View<const float> shading_dn = dark.shading_dn();
  level.seen.pixels += static_cast<std::int64_t>(geometry.rows()) * geometry.cols();
  for (int r = 0; r < geometry.rows(); ++r)
    for (int c = 0; c < geometry.cols(); ++c) {
      const float dn = frame.dn(r, c);
      if (!(dn > dark.floor_dn[as_index(geometry.channel(r, c))]))
        level.at_zero[as_index(geometry.channel(r, c))] += 1.0;
      if (dn < white_dn && !level.seen.codes.reaches(dn)) continue;
      const auto channel = as_index(geometry.channel(r, c));
      if (shading_dn(r, c) > dark.defect_above_dn[channel]) {
        if (dn >= white_dn) filled.emplace(r, c);
        continue;
      }
      level.seen.codes.add(dn);
      if (dn >= white_dn) level.saturated[channel] += 1.0;
      if (dn > white_dn) ++level.seen.above_white;
    }
}

// What looks at the frames of a level one by one.
struct LevelParts {
  const MosaicGeometry& geometry;
  FramePairs pairs;
  LightProfile profile;
  LampFlicker lamp;
  SuccessiveFlats successive;
  std::set<std::pair<int, int>> filled;  ///< defects without light that are at white
};

void note_codes(const RawFrame& frame, const MosaicGeometry& geometry, FlatObservation& seen) {
  for (int c = 0; c < geometry.channels(); ++c) {
    std::vector<float> pixels = some_pixels(frame.dn, geometry, c);
    seen.code_step_dn.push_back(quantization_step(pixels));
    seen.code_spacing_dn.push_back(code_spacing(std::move(pixels)));
  }
}

// Frames that a median of the light tells apart, where more than half and two or more are alike: a
// lamp or an exposure that comes a frame late. Brought to the others' mean, one without light is
// nothing but noise.
std::vector<bool> unlike_frames(const std::vector<double>& signal_dn, const MatchingDark& dark) {
  constexpr double kOfOthers = 0.5, kStandardErrors = 8.0;
  const TemporalAccumulator& frames = dark.own ? *dark.own : *dark.common;
  const double noise = std::sqrt(mean_of(dark.variance_dn2)) +
                       kStandardErrors * mean_of(frames.frame_deviation_dn());
  const double usual = median_of(signal_dn), most = std::max(kOfOthers * std::abs(usual), noise);
  std::vector<bool> unlike;
  for (const double signal : signal_dn) unlike.push_back(std::abs(signal - usual) > most);
  const auto alike = std::count(unlike.begin(), unlike.end(), false);
  if (alike < 2 || 2 * alike <= std::ssize(unlike)) unlike.assign(unlike.size(), false);
  return unlike;
}

PixelPlaces with_filled(const PixelPlaces& defects, const std::set<std::pair<int, int>>& filled) {
  PixelPlaces all;
  std::set_union(defects.begin(), defects.end(), filled.begin(), filled.end(),
                 std::back_inserter(all));
  return all;
}

// What the frames that were added tell together.
void conclude(const LevelParts& parts, const MatchingDark& dark, const FrameRowNoise& rows,
              double step_dn, FlatLevel& level) {
  const TemporalAccumulator& temporal = level.temporal;
  level.left_out = with_filled(dark.defects, parts.filled);
  for (const std::vector<double>& means : temporal.frame_means_dn())
    level.seen.signal_dn.push_back(mean_of(means));
  for (int c = 0; c < parts.geometry.channels(); ++c) {
    const double pixels = static_cast<double>(parts.geometry.channel_pixels(c)) * temporal.frames();
    level.saturated[as_index(c)] /= pixels;
    level.at_zero[as_index(c)] /= pixels;
  }
  if (temporal.frames() < 2) return;
  level.variance_dn2 = temporal.variance_dn2(level.left_out);
  const Flicker flicker = parts.lamp.flicker(level.variance_dn2, rows);
  for (std::size_t c = 0; c < level.variance_dn2.size(); ++c)
    level.variance_dn2[c] -= flicker.variance_dn2[c];
  level.seen.variance_dn2 = level.variance_dn2.front();
  level.seen.mean_variance_dn2 = mean_of(level.variance_dn2);
  const double dark_share =
      std::clamp(mean_of(dark.variance_dn2) / level.seen.mean_variance_dn2, 0.0, 1.0);
  level.neighbours.hold_dark_share(dark_share);
  level.seen.light = parts.profile.change(level.seen.mean_variance_dn2, temporal.alignment(),
                                          flicker.relative_light);
  level.seen.successive = parts.successive.products(1.0 - dark_share);
  // Flicker is most of the variance where the shading is.
  if (flicker.relative_light.empty())
    level.gains = gain_blocks(temporal, parts.geometry, dark.variance_dn2, step_dn);
}

// One pass; unlike: frames that are left out, empty: none.
FlatLevel measure_frames(const GainRun& run, const FrameSet& flat, const MatchingDark& dark,
                         const FrameRowNoise& rows, const std::vector<bool>& unlike) {
  const MosaicGeometry& geometry = run.geometry();
  const std::vector<double> none(dark.level_dn.size(), 0.0);
  FlatLevel level{TemporalAccumulator(geometry, dark.level_dn, FrameAlignment::kAdditive),
                  NeighbourCorrelation(geometry),
                  none,
                  none,
                  {},
                  {},
                  FlatObservation(),
                  GainBlocks()};
  level.seen.name = flat.name;
  LevelParts parts{geometry,
                   FramePairs(level.neighbours, dark.level_dn, kPairsPerLevel),
                   LightProfile(geometry, dark.level_dn),
                   LampFlicker(geometry, dark.level_dn, dark.shading_dn(), dark.defects),
                   SuccessiveFlats(geometry, dark.level_dn, dark.shading_dn()),
                   {}};
  double step_dn = 0;
  run.each_frame(flat, [&](const RawFrame& frame, int i) {
    if (!unlike.empty() && unlike[as_index(i)]) {
      level.seen.unlike.push_back(frame.source);
      return;
    }
    if (level.seen.sources.empty()) {
      step_dn = quantization_step(frame.dn);
      note_codes(frame, geometry, level.seen);
      double signal = 0.0;
      const std::vector<double> mean = channel_means(frame.dn, geometry);
      for (std::size_t c = 0; c < mean.size(); ++c)
        signal += (mean[c] - dark.level_dn[c]) / static_cast<double>(mean.size());
      if (signal > kLampShare * run.format().mean_range_dn())
        level.temporal =
            TemporalAccumulator(geometry, dark.level_dn, FrameAlignment::kMultiplicative);
    }
    level.temporal.add(frame.dn);
    const bool scaled = level.temporal.alignment() == FrameAlignment::kMultiplicative;
    if (scaled && flat.count >= 3)
      parts.successive.add(frame.dn, level.temporal.frame_means_dn().back());
    if (!scaled) parts.lamp.add(frame.dn);
    parts.pairs.add(frame.dn);
    parts.profile.add(frame.dn);
    level.seen.sources.push_back(frame.source);
    count_bright(run, frame, dark, parts.filled, level);
  });
  conclude(parts, dark, rows, step_dn, level);
  return level;
}

}  // namespace

FlatLevel measure_level(const GainRun& run, const FrameSet& flat, const MatchingDark& dark,
                        const FrameRowNoise& rows) {
  FlatLevel level = measure_frames(run, flat, dark, rows, {});
  const std::vector<double> signal_dn = level.seen.signal_dn;
  const std::vector<bool> unlike = unlike_frames(signal_dn, dark);
  const auto first = std::find(unlike.begin(), unlike.end(), true);
  if (first == unlike.end()) return level;
  level = measure_frames(run, flat, dark, rows, unlike);
  level.seen.unlike_dn = signal_dn[as_index(first - unlike.begin())];
  return level;
}

double steady_variance_dn2(const TemporalAccumulator& temporal, std::size_t channel, double mean_dn,
                           double variance_dn2, double dark_variance_dn2) {
  if (temporal.alignment() != FrameAlignment::kMultiplicative) return variance_dn2;
  double scale = 0, square = 0;
  const auto& frames = temporal.frame_means_dn();
  for (const std::vector<double>& frame : frames) {
    if (!(frame[channel] > 0)) return variance_dn2;
    const double a = mean_dn / frame[channel];
    scale += a / static_cast<double>(frames.size());
    square += a * a / static_cast<double>(frames.size());
  }
  return dark_variance_dn2 + (variance_dn2 - square * dark_variance_dn2) / scale;
}

}  // namespace malus
