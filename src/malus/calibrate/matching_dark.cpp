#include "malus/calibrate/internal/matching_dark.h"

#include "malus/base/index.h"
#include "malus/calibrate/internal/fixed_pattern.h"
#include "malus/calibrate/internal/pixel_location.h"
#include "malus/calibrate/internal/zero_share.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {
namespace {

std::vector<double> defect_limits(const GainRun& run, View<const float> shading_dn) {
  const MosaicGeometry& geometry = run.geometry();
  std::vector<double> limits;
  for (int c = 0; c < geometry.channels(); ++c) {
    const PixelLocation usual =
        location_of(geometry, c, [&](int row, int col) { return shading_dn(row, col); });
    const double half = 0.5 * run.format().range_dn(as_index(c));
    limits.push_back(usual.deviation > 0
                         ? std::min(usual.centre + kDefectDeviations * usual.deviation, half)
                         : half);
  }
  return limits;
}

PixelPlaces defects_of(const GainRun& run, View<const float> shading_dn, double step_dn) {
  const MosaicGeometry& geometry = run.geometry();
  std::vector<double> centre, most;
  for (int c = 0; c < geometry.channels(); ++c) {
    const PixelLocation usual =
        location_of(geometry, c, [&](int row, int col) { return shading_dn(row, col); });
    const double half = 0.5 * run.format().range_dn(as_index(c));
    const double deviation = std::max(usual.deviation, least_shown_deviation(step_dn));
    centre.push_back(usual.centre);
    most.push_back(deviation > 0 ? std::min(kDefectDeviations * deviation, half) : half);
  }
  PixelPlaces defects;
  for (int r = 0; r < geometry.rows(); ++r)
    for (int col = 0; col < geometry.cols(); ++col) {
      const auto c = as_index(geometry.channel(r, col));
      if (std::abs(shading_dn(r, col) - centre[c]) > most[c]) defects.emplace_back(r, col);
    }
  return defects;
}

void take_common_shading(const CommonDark& common, MatchingDark& out) {
  out.shading_error_dn2 = common.pass.temporal.variance_dn2();
  for (double& error : out.shading_error_dn2) error /= common.pass.temporal.frames();
  // No number of frames averages out what rounding makes of an offset beside narrow noise.
  out.shading_doubt_dn2.assign(out.shading_error_dn2.size(), 0.0);
  const std::vector<HiddenNoise>& hidden = common.pass.hidden;
  for (std::size_t c = 0; c < hidden.size(); ++c) {
    out.shading_error_dn2[c] += hidden[c].left_dn2;
    out.shading_doubt_dn2[c] = hidden[c].left_stderr_dn2;
  }
  out.bias_shading_dn = common.shading_dn;
  out.shading_frames = common.pass.temporal.frames();
}

void take_common_dark(const DarkPass& common, MatchingDark& out) {
  out.level_dn = common.temporal.mean_dn();
  out.variance_dn2 = common.temporal.variance_dn2();
  out.common = &common.temporal;
  out.zero_share = common.zero_share;
}

// Where the step hides their noise and no dark current moves them, offsets are rounded as in the
// bias frames: the error of that is the same in both, and what it is was found for the bias frames.
bool rounds_as_common(const MatchingDark& own, const DarkPass& common) {
  const std::vector<double> common_level_dn = common.temporal.mean_dn();
  for (std::size_t c = 0; c < own.level_dn.size(); ++c) {
    if (common.hidden.empty() || !common.hidden[c].hidden) return false;
    if (!(own.variance_dn2[c] < common.hidden[c].widest_codes_dn2)) return false;
    if (!common.hidden[c].rounds_alike(own.level_dn[c] - common_level_dn[c])) return false;
  }
  return true;
}

// Dark current differs from pixel to pixel, and a bright flat holds as much of it as a dark frame
// of the same exposure, which EMVA 1288 takes off for that.
void take_own_dark(const GainRun& run, const FrameSet& set, const CommonDark& common,
                   MatchingDark& out) {
  TemporalAccumulator own(run.geometry(), run.format().black_dn, FrameAlignment::kAdditive);
  ZeroShare zeros(run.geometry(), run.zero_dn(), common.pass.floor_dn);
  run.each_frame(set, [&](const RawFrame& frame, int) {
    own.add(frame.dn);
    zeros.add(frame.dn);
  });
  out.zero_share = zeros.shares();
  out.frames = set.count;
  out.level_dn = own.mean_dn();
  out.variance_dn2 = own.variance_dn2();
  out.own_shading_dn = own.release_mean_frame_dn();
  out.own = std::move(own);
  if (rounds_as_common(out, common.pass)) {
    out.own_shading_dn = Image();
    take_common_shading(common, out);
    return;
  }
  out.shading_frames = set.count;
  out.shading_error_dn2 = out.variance_dn2;
  for (double& error : out.shading_error_dn2) error /= set.count;
  out.shading_doubt_dn2.assign(out.level_dn.size(), 0.0);
  subtract_levels(out.own_shading_dn, out.level_dn, run.geometry());
}

bool has_exposure_of(const FrameSet& flat, const FrameSet& dark) {
  constexpr double kSameExposure = 0.01;
  return flat.exposure_s && dark.exposure_s &&
         std::abs(*dark.exposure_s / *flat.exposure_s - 1.0) <= kSameExposure;
}

double darkless_s(const FrameSet& flat, const FrameSet& bias) {
  if (!(flat.exposure_s.value_or(0.0) > 0) || has_exposure_of(flat, bias)) return 0.0;
  return *flat.exposure_s - bias.exposure_s.value_or(0.0);
}

}  // namespace

std::optional<int> own_dark(const FrameSet& flat, const std::vector<const FrameSet*>& darks) {
  for (std::size_t i = 0; i < darks.size(); ++i)
    if (darks[i]->count >= 2 && has_exposure_of(flat, *darks[i])) return static_cast<int>(i);
  return std::nullopt;
}

std::int64_t frames_of_level(const FrameSet& flat, const std::vector<const FrameSet*>& darks) {
  const std::optional<int> own = own_dark(flat, darks);
  return std::int64_t{flat.count} + (own ? darks[as_index(*own)]->count : 0);
}

MatchingDark matching_dark(const GainRun& run, const FrameSet& flat, const CommonDark& common) {
  const std::vector<const FrameSet*>& darks = run.plan().darks;
  MatchingDark out;
  out.floor_dn = common.pass.floor_dn;
  if (const std::optional<int> own = own_dark(flat, darks)) {
    out.set = *own;
    take_own_dark(run, *darks[as_index(*own)], common, out);
  } else {
    take_common_dark(common.pass, out);
    take_common_shading(common, out);
    out.darkless_s = darkless_s(flat, run.bias());
  }
  const std::vector<double> bias_level_dn = common.pass.temporal.mean_dn();
  for (std::size_t c = 0; c < out.level_dn.size(); ++c) {
    out.current_dn.push_back(out.level_dn[c] - bias_level_dn[c]);
    out.level_dn[c] += run.format().black_dn[c];
  }
  out.defect_above_dn = defect_limits(run, out.shading_dn());
  out.defects = defects_of(run, out.shading_dn(), common.pass.step_dn);
  return out;
}

}  // namespace malus
