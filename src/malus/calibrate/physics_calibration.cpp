#include "malus/calibrate/internal/physics_calibration.h"

#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/internal/bias_calibration.h"
#include "malus/calibrate/internal/coarse_steps.h"
#include "malus/calibrate/internal/dark_corrections.h"
#include "malus/calibrate/internal/dark_point.h"
#include "malus/calibrate/internal/defects.h"
#include "malus/calibrate/internal/fixed_pattern.h"
#include "malus/calibrate/internal/flat_calibration.h"
#include "malus/calibrate/internal/flat_checks.h"
#include "malus/calibrate/internal/gain_run.h"
#include "malus/calibrate/internal/matching_dark.h"
#include "malus/calibrate/internal/read_noise_shape.h"
#include "malus/calibrate/internal/row_group.h"
#include "malus/image/quantization.h"
#include "malus/noise/same_sensor.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

// Highest gain first: there row noise is largest against rounding, and the row group is decided.
std::vector<GainPlan> plan_gains(const CalibrationInput& input) {
  require_one_gain_unit(input);
  std::vector<GainPlan> plans;
  for (const FrameSet& set : input.sets) {
    if (set.kind != FrameKind::kBias && set.kind != FrameKind::kFlat) continue;
    auto plan = std::find_if(plans.begin(), plans.end(),
                             [&](const GainPlan& p) { return p.gain == set.gain; });
    if (plan == plans.end())
      plan = plans.insert(plans.end(), GainPlan{set.gain, bias_set_at(set.gain, input), {}, {}});
    if (set.kind == FrameKind::kFlat)
      plan->flats.push_back(&set);
    else if (&set != plan->bias)
      plan->darks.push_back(&set);
  }
  std::stable_sort(plans.begin(), plans.end(), [](const GainPlan& a, const GainPlan& b) {
    return a.gain.decibel().value_or(0.0) > b.gain.decibel().value_or(0.0);
  });
  if (std::none_of(plans.begin(), plans.end(), [](const GainPlan& p) { return p.bias; }))
    throw InputError(input.origin.empty() ? "session" : input.origin, "has no bias frames",
                     "add [[frames]] with kind = \"bias\": frames taken with the lens cap on");
  return plans;
}

// How many frames of a gain are read: its bias frames twice. One alone leaves the flats unread.
std::int64_t frames_read(const GainPlan& plan) {
  if (!plan.bias) return 0;
  std::int64_t total = 2 * std::int64_t{plan.bias->count};
  for (const FrameSet* flat : plan.flats)
    if (plan.bias->count >= 2) total += frames_of_level(*flat, plan.darks);
  return total;
}

// The row group in force: declared, or what the frames showed, or one row until they do.
class RowGroupDecision {
 public:
  explicit RowGroupDecision(std::optional<int> declared) : declared_(declared) {}

  std::optional<int> declared() const { return declared_; }

  /// matters: whether results depend on the row group; if not, failing to find one is not told.
  /// against_declared: what the frames tell against the declaration where none is found.
  int update(const Estimate<int>& found, bool matters, const std::string& against_declared,
             std::vector<std::string>& warnings) {
    if (declared_) {
      if (found && *found != *declared_)
        warnings.push_back(
            fmt::format("the session declares a row group of {}, the frames look "
                        "like one of {}: check the declaration",
                        *declared_, *found));
      else if (!found && !against_declared.empty())
        warnings.push_back(
            fmt::format("the session declares a row group of {}, counted from row 0, but {}",
                        *declared_, against_declared));
      return *declared_;
    }
    if (!found) {
      if (!detected_ && matters)
        warnings.push_back(fmt::format("row group not decided, taken as 1: {}", found.reason()));
    } else if (!detected_) {
      detected_ = *found;
    } else if (*detected_ != *found) {
      warnings.push_back(fmt::format("this gain looks like a row group of {}, others like {}",
                                     *found, *detected_));
    }
    return detected_.value_or(1);
  }
  int value() const { return declared_ ? *declared_ : detected_.value_or(1); }
  std::string origin() const { return declared_ ? "declared" : detected_ ? "detected" : "assumed"; }

 private:
  std::optional<int> declared_, detected_;
};

double mean_temporal_variance(const DarkPass& dark) {
  const std::vector<double> variance = dark.temporal.variance_dn2();
  return std::accumulate(variance.begin(), variance.end(), 0.0) /
         static_cast<double>(variance.size());
}

int update_row_group(const DarkPass& dark, RowGroupDecision& decision,
                     std::vector<std::string>& warnings) {
  if (dark.rows.frames() < 2)
    return decision.update(Undecided{"one bias frame cannot tell row noise from fixed rows"}, true,
                           {}, warnings);
  const double temporal_dn2 = mean_temporal_variance(dark);
  const RowVariance row = row_variance_of(dark.rows, temporal_dn2, dark.rows.cols());
  const std::string against =
      decision.declared() ? contradiction_of_group(dark.rows, row, *decision.declared()) : "";
  return decision.update(detect_row_group(dark.rows, row), row_noise_matters(row, temporal_dn2),
                         against, warnings);
}

// Row noise is the spread of a channel's row groups.
void require_row_groups(const GainRun& run) {
  const MosaicGeometry& geometry = run.geometry();
  for (int c = 0; c < geometry.channels(); ++c)
    if (geometry.channel_groups(c) < 2)
      throw InputError(run.format().source,
                       fmt::format("its {} rows are one row group of {}: nothing to compare",
                                   geometry.rows(), geometry.row_group()),
                       "correct row_group, or leave it out");
}

void warn_of_many_defects(const FoundDefects& defects, const MosaicGeometry& geometry,
                          PhysicsCalibration& out) {
  const double pixels = static_cast<double>(geometry.rows()) * geometry.cols();
  const double share = static_cast<double>(defects.found) / pixels;
  const bool all = defects.found == std::ssize(defects.listed);
  if (all && !(share > kManyDefects)) return;
  out.warnings.push_back(fmt::format(
      "{} pixels, {} % of the sensor, are {}: are the frames all of this camera and of one "
      "setting?",
      defects.found, percent_text(share),
      all ? "listed as defects, and denoise fills them all"
          : fmt::format("defects; the worst {} of them are listed, and denoise fills those",
                        defects.listed.size())));
}

// A few pixels with a hundred times the noise would be most of a variance that the list of defects
// tells already. Their means scatter as much: what is left out of the temporal variance is left out
// of the spatial one, or DSNU keeps a tenth of it from ten frames.
void leave_defects_out(const DarkPixels& dark, const std::vector<DefectPixel>& defects,
                       const MosaicGeometry& geometry, PhysicsCalibration& out) {
  if (defects.empty()) return;
  const std::vector<double> excess = temporal_excess_dn2(dark, defects, geometry);
  for (std::size_t c = 0; c < excess.size(); ++c) {
    double& sd = out.temporal_sd_dark_dn[c];
    sd = std::sqrt(std::max(sd * sd - excess[c], 0.0));
  }
  const OrdinaryPixels ordinary =
      ordinary_pixels(out.dark_shading_dn, 0.0, geometry, defects, dark.sum_of_squares);
  measure_dsnu(ordinary, temporal_of(ordinary, dark.frames), geometry, out);
}

// Dark frames besides the bias frames serve flats of their exposure alone.
void warn_of_unused_darks(const GainPlan& plan, PhysicsCalibration& out) {
  std::string unused;
  for (std::size_t i = 0; i < plan.darks.size(); ++i)
    if (std::none_of(plan.flats.begin(), plan.flats.end(), [&](const FrameSet* flat) {
          return own_dark(*flat, plan.darks) == static_cast<int>(i);
        }))
      unused += (unused.empty() ? "" : "; ") + frame_set_name(*plan.darks[i]);
  if (!unused.empty())
    out.warnings.push_back(
        unused +
        ": not used; per gain the largest set of bias frames is, and dark sets of two "
        "frames or more whose exposure is a flat's, to 1 %");
}

struct CalibratedGain {
  PhysicsCalibration physics;
  std::vector<DefectPixel> defects;
};

CalibratedGain calibrate_gain(GainRun& run, double step_dn, RowGroupDecision& row_group) {
  CalibratedGain result;
  PhysicsCalibration& out = result.physics;
  out.gain = run.plan().gain;
  DarkPass dark = measure_dark(run, step_dn);
  warn_of_unused_darks(run.plan(), out);
  const int rows = update_row_group(dark, row_group, out.warnings);
  run.set_row_group({rows, row_group.origin() != "assumed"});
  require_row_groups(run);
  measure_bias(run, dark, out);
  if (run.bias().count < 2) {
    out.warnings.push_back(
        "only one bias frame: its fixed pattern is part of the read noise, and the gain K cannot "
        "be measured; take 20 or more");
    return result;
  }
  warn_of_temporal_filter(dark.successive, out);
  const MosaicGeometry& geometry = run.geometry();
  if (run.plan().flats.empty()) {
    out.warnings.emplace_back(kWithoutFlats);
    warn_of_alike_neighbours(dark.neighbours, NeighbourCorrelation(geometry), out);
    warn_of_scaled_codes({}, {.codes = dark.codes}, out);
  } else {
    measure_flats(run, dark, out);
  }
  DarkPixels pixels = dark_pixels(dark, out.dark_shading_dn);
  for (std::size_t c = 0; c < out.lambda.mean.size(); ++c)
    pixels.tails.push_back({out.lambda.mean[c], out.sigma_tl.mean[c]});
  FoundDefects defects = find_defects(pixels, out.prnu_map, geometry);
  warn_of_many_defects(defects, geometry, out);
  result.defects = std::move(defects.listed);
  leave_defects_out(pixels, result.defects, geometry, out);
  widen_by_coarse_steps(dark.step_dn, dark.hidden, out);
  settle_dark_points(dark.hidden, out);
  if (!run.settings().single_frame && run.settings().shape != "ppcc")
    keep_dark_variance(dark.step_dn, out);
  restore_dsnu(dark, out);
  if (dark.doubtful_drift) out.row_drift = {};
  if (!run.settings().maps) {
    out.dark_shading_dn = Image();
    out.prnu_map = Image();
  }
  return result;
}

// What concerns the whole calibration is said at once, and kept for who reads the model later.
void warn_of_calibration(const std::string& text, NoiseModel& model, Progress& progress) {
  progress.warn(text);
  model.warnings.push_back(text);
}

// Black and white when neither the session nor the files tell them: said, because μ then holds the
// whole dark level, and saturated flats are known by the largest values alone.
void settle_levels(const std::vector<GainPlan>& plans, RawFrame& first, NoiseModel& model,
                   Progress& progress) {
  const auto say = [&](const std::string& text) { warn_of_calibration(text, model, progress); };
  if (const std::string note = declaration_note(first); !note.empty())
    say(fmt::format("{}: {}", first.source, note));
  if (!first.black_known)
    say(
        fmt::format("the black level is not given, taken as {:g}: mu holds the rest of "
                    "the dark level; give black in [sensor]",
                    first.black_dn.front()));
  if (first.white_known) return;
  for (const GainPlan& plan : plans)
    for (const FrameSet* flat : plan.flats)
      first.white_dn = std::max(first.white_dn, flat->load(0).white_dn);
  say(
      fmt::format("the white level is not given, taken as {:g}: saturated flats may be "
                  "missed; give white in [sensor]",
                  first.white_dn));
}

// Files that state another black level than those of the highest gain: said, because frames that
// state none get the model's.
void warn_of_own_black(const RawFrame& own, const RawFrame& first, PhysicsCalibration& out) {
  if (!own.black_known || !first.black_known || own.black_dn == first.black_dn) return;
  const double black = mean_of(own.black_dn);
  out.warnings.push_back(fmt::format(
      "its files tell a black level of {0:.6g} DN, those of the highest gain {1:.6g} DN: "
      "mu is above each file's own; frames at this gain that tell none need "
      "the black level {0:.6g}",
      black, mean_of(first.black_dn)));
}

// Gain that a camera makes by multiplying has wider steps. Dark frames whose noise the step hides
// may hold one code alone, which tells no step: flats do.
double step_of(const GainPlan& plan, const RawFrame& dark) {
  const double step = quantization_step(dark.dn);
  const auto& pixels = dark.dn.values();
  const bool one_code =
      std::all_of(pixels.begin(), pixels.end(), [&](float dn) { return dn == pixels.front(); });
  if (step > 0 || plan.flats.empty() || !one_code) return step;
  return quantization_step(plan.flats.front()->load(0).dn);
}

// The sensor's step is the smallest of its gains'. steps_dn: one per gain of the model, 0 where
// frames are not made of whole numbers or all alike.
void settle_step(const std::vector<double>& steps_dn, NoiseModel& model) {
  model.quantization_dn = 0;
  for (const double step : steps_dn)
    if (step > 0 && (model.quantization_dn == 0 || step < model.quantization_dn))
      model.quantization_dn = step;
  for (std::size_t i = 0; i < steps_dn.size(); ++i)
    if (steps_dn[i] > model.quantization_dn && model.quantization_dn > 0)
      model.physics[i].warnings.push_back(
          fmt::format("its codes are multiples of {:g} DN, those of other gains of {:g}: frames "
                      "drawn at it are rounded to the smaller step",
                      steps_dn[i], model.quantization_dn));
}

// More gain makes more DN of an electron. A change of conversion gain adds to what is told; nothing
// takes from it but gains that are exchanged or written in another unit.
void warn_of_K_against_gain(std::vector<PhysicsCalibration>& rising) {
  constexpr double kErrors = 4.0, kLeastOfTold = 0.5, kLeastStepDb = 2.0;
  const PhysicsCalibration* before = nullptr;
  for (PhysicsCalibration& p : rising) {
    if (p.K.mean.empty() || !p.gain.decibel()) continue;
    if (before) {
      const double low = mean_of(before->K.mean), high = mean_of(p.K.mean);
      const double error =
          std::hypot(mean_of(before->K.standard_error), mean_of(p.K.standard_error));
      const double told_db = *p.gain.decibel() - *before->gain.decibel();
      const double found_db = 20.0 * std::log10(high / low);
      if (high < low - kErrors * error)
        p.warnings.push_back(
            fmt::format("K falls to {:.4g} DN/e- from {:.4g} at {}: are the gains of their frames "
                        "exchanged?",
                        high, low, before->gain.text()));
      else if (p.gain.gain_db && told_db > kLeastStepDb && found_db < kLeastOfTold * told_db)
        p.warnings.push_back(
            fmt::format("K rises by {:.3g} dB from that at {}: is gain_db in decibels, a factor of "
                        "10 per 20 dB?",
                        found_db, before->gain.text()));
    }
    before = &p;
  }
}

}  // namespace

NoiseModel calibrate_physics(const CalibrationInput& input, const CalibrationSettings& settings,
                             Progress& progress) {
  return physics_with_format(input, settings, progress).model;
}

CalibratedPhysics physics_with_format(const CalibrationInput& input,
                                      const CalibrationSettings& settings, Progress& progress) {
  require_settings(settings);
  const std::vector<GainPlan> plans = plan_gains(input);
  std::int64_t steps = 0;
  for (const GainPlan& plan : plans) steps += frames_read(plan);
  progress.begin("calibrating", steps);
  CalibratedPhysics out;
  NoiseModel& model = out.model;
  FrameFormat& format = out.format;
  model.sensor = input.sensor;
  model.origin = input.origin;
  if (std::any_of(plans.begin(), plans.end(), [](const GainPlan& p) { return !p.flats.empty(); }))
    model.saturation_limit = settings.saturation_limit;
  RowGroupDecision row_group(input.row_group);
  RawFrame first;  // of the highest gain
  std::vector<double> steps_dn;
  for (const GainPlan& plan : plans) {
    if (!plan.bias) {
      warn_of_calibration(gain_prefix(plan.gain) + "flat frames without bias frames are left out",
                          model, progress);
      continue;
    }
    const RawFrame own_first = load_first(*plan.bias);
    steps_dn.push_back(step_of(plan, own_first));
    if (model.physics.empty()) {
      first = own_first;
      settle_levels(plans, first, model, progress);
      format = format_of(first);
      model.layout = first.layout;
      model.black_dn = first.black_dn;
      model.white_dn = first.white_dn;
    }
    GainRun run(plan, format, own_first, settings, progress);
    CalibratedGain gain = calibrate_gain(run, steps_dn.back(), row_group);
    model.physics.push_back(std::move(gain.physics));
    warn_of_own_black(own_first, first, model.physics.back());
    // The response belongs to the sensor, not to a gain: the map of the lowest gain is kept.
    if (!model.physics.back().prnu_map.empty())
      for (std::size_t i = 0; i + 1 < model.physics.size(); ++i)
        model.physics[i].prnu_map = Image();
    if (gain.defects.size() > model.defects.size()) model.defects = std::move(gain.defects);
  }
  settle_step(steps_dn, model);
  model.row_group = row_group.value();
  model.row_group_origin = row_group.origin();
  std::reverse(model.physics.begin(), model.physics.end());
  if (model.physics.size() >= 2) {
    warn_of_K_against_gain(model.physics);
    if (const auto joint = fit_joint_model(model.physics))
      model.joint = *joint;
    else
      warn_of_calibration("no joint model over gain: " + joint.reason(), model, progress);
  }
  return out;
}

}  // namespace malus
