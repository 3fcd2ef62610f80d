#include "malus/denoise/frame_complaints.h"

#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/two_outputs.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>

namespace malus {
namespace {

// A filter keeps means unless the noise it was told of is not the frame's.
std::string moved_mean(const RawFrame& frame, const Denoised& result, const NoiseProfile& profile,
                       const std::string& network) {
  constexpr double kOfMean = 0.05, kOfDeviation = 0.05;
  if (static_cast<std::size_t>(result.nonfinite_pixels) == result.dn_above_black.size())
    return {};                           // nothing had a mean
  if (result.cut_off_undone) return {};  // dark places are meant to come out darker
  std::optional<std::size_t> worst;
  for (std::size_t k = 0; k < result.mean_dn.size(); ++k) {
    const double shift = std::abs(result.mean_shift_dn[k]);
    if (shift > kOfMean * std::abs(result.mean_dn[k]) + kOfDeviation * result.sigma_used_dn[k] &&
        (!worst || shift > std::abs(result.mean_shift_dn[*worst])))
      worst = k;
  }
  if (!worst) return {};
  const double before = result.mean_dn[*worst], after = before + result.mean_shift_dn[*worst];
  return fmt::format(
      "denoising moved the mean of channel {} from {:.4g} to {:.4g} DN: {}{}",
      frame.layout.channel_names()[*worst], before, after,
      network.empty() ? ""
                      : fmt::format("{} does not suit the frame (see with {}), or ", network,
                                    setting("method", "nl-ridge")),
      profile.estimated_from_picture
          ? "texture was taken for noise; give the camera's model with " + setting("model")
          : fmt::format("the frame's noise is not the model's; check {}, {} and {}",
                        setting("gain"), setting("black"), setting("model")));
}

std::string many_defects(const Denoised& result) {
  const double share =
      static_cast<double>(result.defect_pixels) / static_cast<double>(result.dn_above_black.size());
  if (!(share > kManyDefects)) return {};
  return fmt::format(
      "{} pixels, {} % of the frame, are defects by the model's list and were filled from their "
      "neighbours; {} keeps them",
      result.defect_pixels, percent_text(share), setting("defects", false));
}

// Beyond its edges a frame goes on as its mirror image, which of a few cells is all that is like
// it.
std::string few_pixels(const Denoised& result) {
  constexpr int kEnough = 24;  // each way
  const int least = std::min(result.dn_above_black.rows(), result.dn_above_black.cols());
  if (!result.variance_dn2 || least >= kEnough) return {};
  return fmt::format(
      "has {} one way: the filter finds little but mirror images of its own pixels there, and the "
      "stated error is too small; denoise it with more of what is around it",
      counted(least, "pixel"));
}

}  // namespace

std::string tile_work_complaint(int tiles, double work, double whole_mib) {
  constexpr double kMuchWork = 2;
  if (!(work > kMuchWork)) return {};
  return fmt::format(
      "{} tiles, with what each needs around it, take {:.1f} times the work of the frame in one "
      "piece, for which {} is enough",
      tiles, work, setting("memory", fmt::format("{:.0f}", whole_mib)));
}

std::vector<std::string> frame_complaints(const Denoised& result, bool polarized,
                                          std::int64_t of_picture) {
  constexpr double kManySaturated = 0.01;  // lamps and their reflections are fewer
  constexpr double kMuchCutOff = 0.01;
  std::vector<std::string> lines;
  if (const std::int64_t odd = result.nonfinite_pixels; odd > 0)
    lines.push_back(fmt::format("{} NaN, infinite, or beyond {:g} times white; ",
                                counted_are(odd, "pixel"), kMostWhites) +
                    (of_picture > 0 ? odd == 1 ? "it is filled from its neighbours"
                                               : "they are filled from their neighbours"
                     : odd == 1     ? "it stays as it is"
                                    : "they stay as they are"));
  const double saturated =
      static_cast<double>(result.saturated_pixels) /
      static_cast<double>(of_picture > 0 ? of_picture : std::ssize(result.dn_above_black.values()));
  if (saturated > kManySaturated)
    lines.push_back(
        fmt::format("{} pixels, {} % of the frame, are saturated: they are brighter than they say, "
                    "by how much is not known; expose less",
                    result.saturated_pixels, percent_text(saturated)));
  if (result.cut_off_share > kMuchCutOff)
    lines.push_back(fmt::format(
        "{} % of its pixels are 0, where the camera cut the noise of dark places off: {}; raise "
        "the camera's black level by a few deviations of the noise",
        percent_text(result.cut_off_share),
        result.cut_off_undone ? "their light is worked out as far as the noise is known"
        : polarized           ? "the light there and its DoLP come out wrong"
                              : "the light there comes out wrong"));
  if (result.frames_cut_off_share > kMuchCutOff)
    lines.push_back(fmt::format(
        "the camera cut the noise of dark places off at 0, in about {} % of the pixels of the "
        "frames that it is the mean of: the mean is too bright there{}; raise the camera's black "
        "level by a few deviations of the noise, or denoise the frames one by one",
        percent_text(result.frames_cut_off_share), polarized ? ", and its DoLP too low" : ""));
  return lines;
}

std::vector<std::string> result_complaints(const RawFrame& before, const Denoised& result,
                                           const NoiseProfile& profile,
                                           const std::string& network) {
  std::vector<std::string> lines = frame_complaints(result, before.layout.polarized());
  const auto add = [&](std::string line) {
    if (!line.empty()) lines.push_back(std::move(line));
  };
  add(many_defects(result));
  add(few_pixels(result));
  // One cause, one line: a mean moves because the noise is another.
  const std::string noise = result.noise ? noise_complaint(*result.noise) : "";
  add(noise.empty() ? moved_mean(before, result, profile, network) : noise);
  return lines;
}

std::string extrapolation_complaint(const NoiseModel& model, const GainSetting& gain) {
  if (std::string untold = untold_gain_complaint(model, {gain}); !untold.empty()) return untold;
  if (!gain.decibel() || !model.joint) return {};
  // Of the gains with K, which are not all that are held.
  const double lowest_db = model.joint->segments.front().knots_db.front(),
               highest_db = model.joint->segments.back().knots_db.back();
  if (*gain.decibel() >= lowest_db && *gain.decibel() <= highest_db) return {};
  const auto named = [&](double db) {
    return GainSetting::at_decibel(db, gain.iso.has_value()).text();
  };
  return fmt::format("extrapolated to {} from the calibrated range {} to {}", gain.text(),
                     named(lowest_db), named(highest_db));
}

std::vector<std::string> cut_off_complaints(const NoiseModel& model, const GainSetting& gain,
                                            bool undone) {
  std::vector<std::string> lines;
  for (const PhysicsCalibration* p : model.physics_around(gain)) {
    if (!p->dark_was_cut_off()) continue;
    const auto most = std::max_element(p->dark_zero_share.begin(), p->dark_zero_share.end());
    const double bias_dn = p->mu.mean[static_cast<std::size_t>(most - p->dark_zero_share.begin())];
    lines.push_back(fmt::format(
        "{} % of the dark pixels it was calibrated from were 0: its bias, {:.3g} DN, is that of "
        "noise cut off at 0, and {}; raise the camera's black level and calibrate again",
        percent_text(*most), bias_dn,
        undone ? "what it was before is worked out as of normal noise"
               : "light comes out about as much too dark"));
  }
  return lines;
}

std::vector<std::string> two_outputs_complaints(const NoiseModel& model, const GainSetting& gain) {
  for (const PhysicsCalibration* p : model.physics_around(gain))
    for (const std::string& warning : p->warnings)
      if (warning.starts_with(kTwoOutputsFinding)) return {warning};
  return {};
}

std::vector<std::string> complaints_at_gain(const NoiseModel& model, const GainSetting& gain,
                                            bool undone) {
  std::vector<std::string> lines = {extrapolation_complaint(model, gain)};
  for (const auto& found :
       {cut_off_complaints(model, gain, undone), two_outputs_complaints(model, gain)})
    lines.insert(lines.end(), found.begin(), found.end());
  std::erase(lines, "");
  return lines;
}

}  // namespace malus
