#include "malus/calibrate/internal/flat_level.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/internal/light_profile.h"
#include "malus/image/quantization.h"

#include <algorithm>
#include <cstdint>
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

void note_codes(const RawFrame& frame, const MosaicGeometry& geometry, FlatObservation& seen) {
  for (int c = 0; c < geometry.channels(); ++c) {
    std::vector<float> pixels = some_pixels(frame.dn, geometry, c);
    seen.code_step_dn.push_back(quantization_step(pixels));
    seen.code_spacing_dn.push_back(code_spacing(std::move(pixels)));
  }
}

}  // namespace

FlatLevel measure_level(const GainRun& run, const FrameSet& flat, const MatchingDark& dark) {
  const MosaicGeometry& geometry = run.geometry();
  FlatLevel level{TemporalAccumulator(geometry, dark.level_dn, FrameAlignment::kAdditive),
                  NeighbourCorrelation(geometry),
                  std::vector<double>(dark.level_dn.size(), 0.0),
                  std::vector<double>(dark.level_dn.size(), 0.0),
                  {},
                  FlatObservation(),
                  GainBlocks()};
  level.seen.name = flat.name;
  FramePairs pairs(level.neighbours, dark.level_dn, kPairsPerLevel);
  LightProfile profile(geometry, dark.level_dn);
  SuccessiveFlats successive(geometry, dark.level_dn, dark.shading_dn());
  std::set<std::pair<int, int>> filled;
  double step_dn = 0;
  run.each_frame(flat, [&](const RawFrame& frame, int i) {
    if (i == 0) {
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
    if (level.temporal.alignment() == FrameAlignment::kMultiplicative && flat.count >= 3)
      successive.add(frame.dn, level.temporal.frame_means_dn().back());
    pairs.add(frame.dn);
    profile.add(frame.dn);
    level.seen.sources.push_back(frame.source);
    count_bright(run, frame, dark, filled, level);
  });
  level.filled.assign(filled.begin(), filled.end());
  for (const std::vector<double>& means : level.temporal.frame_means_dn())
    level.seen.signal_dn.push_back(mean_of(means));
  if (flat.count >= 2) {
    const std::vector<double> variance = level.temporal.variance_dn2();
    level.seen.variance_dn2 = variance.front();
    level.seen.mean_variance_dn2 = mean_of(variance);
    level.neighbours.hold_dark_share(
        std::clamp(mean_of(dark.variance_dn2) / level.seen.mean_variance_dn2, 0.0, 1.0));
    level.seen.light = profile.change(level.seen.mean_variance_dn2, level.temporal.alignment());
    level.seen.successive = successive.products(
        std::clamp(1.0 - mean_of(dark.variance_dn2) / level.seen.mean_variance_dn2, 0.0, 1.0));
    level.gains = gain_blocks(level.temporal, geometry, dark.variance_dn2, step_dn);
  }
  for (int c = 0; c < geometry.channels(); ++c) {
    const double pixels = static_cast<double>(geometry.channel_pixels(c)) * flat.count;
    level.saturated[as_index(c)] /= pixels;
    level.at_zero[as_index(c)] /= pixels;
  }
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
