// All kinds of model: which are made of what. The physics one has a file of its own.
#include "malus/calibrate/calibrate.h"

#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/calibrate/gaussian_calibration.h"
#include "malus/calibrate/internal/physics_calibration.h"
#include "malus/calibrate/nonparametric_calibration.h"
#include "malus/image/quantization.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus {
namespace {

bool contains(const std::vector<ModelKind>& kinds, ModelKind kind) {
  return std::find(kinds.begin(), kinds.end(), kind) != kinds.end();
}

bool has_frames(const CalibrationInput& input, FrameKind kind) {
  return std::any_of(input.sets.begin(), input.sets.end(),
                     [kind](const FrameSet& set) { return set.kind == kind; });
}

// The reference of a burst: the one with its level label, else the only one.
const FrameSet* reference_for(const FrameSet& burst, const CalibrationInput& input) {
  const FrameSet* found = nullptr;
  int references = 0;
  for (const FrameSet& set : input.sets) {
    if (set.kind != FrameKind::kReference || set.count < 1) continue;
    ++references;
    if (!found || set.level == burst.level) found = &set;
  }
  return references == 1 || (found && found->level == burst.level) ? found : nullptr;
}

// Sources of noise at one gain, dark ones first.
std::vector<NoiseSource> sources_at(const GainSetting& gain, const CalibrationInput& input) {
  std::vector<NoiseSource> sources;
  if (const FrameSet* bias = bias_set_at(gain, input)) sources.push_back({bias, nullptr});
  for (const FrameKind kind : {FrameKind::kFlat, FrameKind::kBurst})
    for (const FrameSet& set : input.sets)
      if (set.kind == kind && set.gain == gain)
        sources.push_back({&set, kind == FrameKind::kBurst ? reference_for(set, input) : nullptr});
  return sources;
}

std::vector<GainSetting> lit_gains(const CalibrationInput& input) {
  std::vector<GainSetting> gains;
  for (const FrameSet& set : input.sets)
    if ((set.kind == FrameKind::kFlat || set.kind == FrameKind::kBurst) && set.count >= 2 &&
        std::find(gains.begin(), gains.end(), set.gain) == gains.end())
      gains.push_back(set.gain);
  std::sort(gains.begin(), gains.end(), [](const GainSetting& a, const GainSetting& b) {
    return a.decibel().value_or(0.0) < b.decibel().value_or(0.0);
  });
  return gains;
}

// Gains with frames of a lit scene; InputError where there are none.
std::vector<GainSetting> required_lit_gains(const CalibrationInput& input, const char* kind) {
  std::vector<GainSetting> gains = lit_gains(input);
  if (gains.empty())
    throw InputError(input.origin, "has no bursts or flats of two frames or more",
                     fmt::format("a {} model needs noise at many signal levels", kind));
  return gains;
}

// A gain's frames that tell no black level have that of the physics results, and so has whatever is
// compared with them; frames that tell their own where those do, too, lie above it either way.
void take_black_of_physics(const FrameFormat& of_physics, RawFrame& first) {
  if (first.black_known && of_physics.black_known) return;
  first.black_dn = of_physics.black_dn;
  first.black_known = of_physics.black_known;
}

// The distributions at these gains; what the model does not know of the sensor yet is taken from
// the first frame. of_physics: null without physics results.
std::vector<MeasuredLevels> measure_gains(const CalibrationInput& input,
                                          const std::vector<GainSetting>& gains,
                                          const FrameFormat* of_physics,
                                          const CalibrationSettings& settings, Progress& progress,
                                          NoiseModel& model) {
  std::int64_t steps = 0;
  for (const GainSetting& gain : gains)
    for (const NoiseSource& source : sources_at(gain, input))
      steps += 2 * source.frames->count + (source.reference ? source.reference->count : 0);
  progress.begin("distributions", steps);
  std::vector<MeasuredLevels> measured;
  for (const GainSetting& gain : gains) {
    std::vector<NoiseSource> sources = sources_at(gain, input);
    RawFrame first = load_first(*sources.front().frames);
    if (model.white_dn > 0) first.white_dn = model.white_dn;
    if (of_physics) take_black_of_physics(*of_physics, first);
    if (model.black_dn.empty()) {
      model.layout = first.layout;
      model.black_dn = first.black_dn;
      model.white_dn = first.white_dn;
      model.quantization_dn = quantization_step(first.dn);
    }
    const auto physics = std::find_if(model.physics.begin(), model.physics.end(),
                                      [&](const PhysicsCalibration& p) { return p.gain == gain; });
    measured.push_back(measure_levels({std::move(sources), std::move(first)},
                                      physics == model.physics.end() ? nullptr : &*physics,
                                      model.row_group, settings, progress));
  }
  return measured;
}

// From the photon-transfer line where flats gave one, else from the levels of bursts.
void add_gaussian(const CalibrationInput& input, const FrameFormat* of_physics,
                  const CalibrationSettings& settings, Progress& progress, NoiseModel& model) {
  for (const PhysicsCalibration& physics : model.physics)
    if (!physics.K.mean.empty()) model.gaussian.push_back(gaussian_of(physics));
  std::vector<GainSetting> missing;
  for (const GainSetting& gain : required_lit_gains(input, "Gaussian"))
    if (std::none_of(model.gaussian.begin(), model.gaussian.end(),
                     [&](const GaussianCalibration& g) { return g.gain == gain; }))
      missing.push_back(gain);
  // Variances need fewer samples than distributions, and the line weighs levels by theirs.
  constexpr int kSamples = 2000;
  CalibrationSettings of_variances = settings;
  of_variances.level_samples = std::min(settings.level_samples, kSamples);
  const auto measured = measure_gains(input, missing, of_physics, of_variances, progress, model);
  for (const MeasuredLevels& levels : measured) {
    const double range = white_above_black(model.white_dn, model.black_dn);
    const auto line = gaussian_of(levels, settings.saturation_limit * range);
    if (!line)
      throw InputError(input.origin,
                       fmt::format("{}no line of variance against signal: {}",
                                   gain_prefix(levels.distributions.gain), line.reason()),
                       "give a burst of a scene with many signal levels, or flats, or lower " +
                           setting("level_samples"));
    model.gaussian.push_back(*line);
  }
  std::sort(model.gaussian.begin(), model.gaussian.end(),
            [](const GaussianCalibration& a, const GaussianCalibration& b) {
              return a.gain.decibel().value_or(0.0) < b.gain.decibel().value_or(0.0);
            });
}

// Whole bias frames for dark-frame sampling, cut to whole cells, in DN above black. format: what
// the physics results count from.
void add_dark_frames(const CalibrationInput& input, const FrameFormat& format,
                     const CalibrationSettings& settings, Progress& progress, NoiseModel& model) {
  std::vector<const FrameSet*> sets;
  for (const FrameSet& set : input.sets)
    if (&set == bias_set_at(set.gain, input)) sets.push_back(&set);
  std::sort(sets.begin(), sets.end(), [](const FrameSet* a, const FrameSet* b) {
    return a->gain.decibel().value_or(0.0) < b->gain.decibel().value_or(0.0);
  });
  std::int64_t steps = 0;
  for (const FrameSet* set : sets) steps += std::min(set->count, settings.dark_frames);
  progress.begin("dark frames", steps);
  for (const FrameSet* set : sets) {
    DarkFrameBank bank;
    bank.gain = set->gain;
    FrameSet kept = *set;
    kept.count = std::min(set->count, settings.dark_frames);
    for_each_frame(kept, &format, progress, [&](const RawFrame& frame, int) {
      Image dark(frame.dn.rows() / frame.layout.rows() * frame.layout.rows(),
                 frame.dn.cols() / frame.layout.cols() * frame.layout.cols());
      for (int r = 0; r < dark.rows(); ++r)
        for (int c = 0; c < dark.cols(); ++c)
          dark(r, c) = frame.dn(r, c) - static_cast<float>(format.black_at(r, c));
      bank.frames_dn.push_back(std::move(dark));
    });
    model.dark_frames.push_back(std::move(bank));
  }
}

// What the physics results said of the frames is true of every kind that is made of the same
// frames, but for what they lack themselves. To the first kind that has the gain: once is enough.
void keep_warnings_of_physics(NoiseModel& model, Progress& progress) {
  const auto given = [](auto& kinds, const PhysicsCalibration& from) {
    const auto kind = std::find_if(kinds.begin(), kinds.end(),
                                   [&](const auto& one) { return one.gain == from.gain; });
    if (kind == kinds.end()) return false;
    kind->warnings.insert(kind->warnings.begin(), from.warnings.begin(), from.warnings.end());
    return true;
  };
  for (PhysicsCalibration& physics : model.physics) {
    std::vector<std::string>& said = physics.warnings;
    said.erase(std::remove(said.begin(), said.end(), kWithoutFlats), said.end());
    if (!given(model.gaussian, physics) && !given(model.nonparametric, physics))
      for (const std::string& warning : physics.warnings)
        progress.warn(gain_prefix(physics.gain) + warning);
  }
}

// Noise that is cut off: only the physics results, and what is made of them, are of what it was
// before. Where light lifts all of it above the cut, draws of it as it shows are not of the camera.
void warn_of_noise_as_it_shows(NoiseModel& model, Progress& progress) {
  for (const PhysicsCalibration& physics : model.physics) {
    const std::vector<double>& zeros = physics.dark_zero_share;
    if (!std::ranges::any_of(zeros, [](double share) { return share > kMostDarkZeros; })) continue;
    const auto text = [](const char* what, const char* where, const char* but) {
      return fmt::format(
          "the camera cuts the dark noise off, and {} hold it as it shows: {} light they are drawn "
          "too bright and too weak{}; raise the black level, or draw of a physics model",
          what, where, but);
    };
    for (NonparametricCalibration& distributions : model.nonparametric)
      if (distributions.gain == physics.gain)
        distributions.warnings.push_back(
            text("the distributions", "at dim", ", less so the wider row noise is"));
    for (const DarkFrameBank& bank : model.dark_frames) {
      if (bank.gain != physics.gain) continue;
      model.warnings.push_back(gain_prefix(bank.gain) + text("dark frames", "in", ""));
      progress.warn(model.warnings.back());
    }
  }
}

// Frames of several gains that nobody tells count as of one, whose K is between theirs; what is
// wrong with them then has this cause too. A camera of one gain has nothing to tell.
void warn_of_untold_gain(const CalibrationInput& input, NoiseModel& model, Progress& progress) {
  const bool is_told = std::ranges::any_of(
      input.sets, [](const FrameSet& set) { return set.gain.decibel().has_value(); });
  const bool is_odd = std::ranges::any_of(
      model.physics, [](const PhysicsCalibration& gain) { return !gain.warnings.empty(); });
  if (is_told || !is_odd) return;
  model.warnings.push_back(
      "the gain is not told: frames of several gains would count as of one; give gain_db or iso "
      "with the frames if they are");
  progress.warn(model.warnings.back());
}

}  // namespace

NoiseModel calibrate(const CalibrationInput& input, const CalibrationSettings& settings,
                     const std::vector<ModelKind>& kinds, Progress& progress) {
  require_settings(settings);
  if (kinds.empty())
    throw InputError(setting_name("kinds"), "names no kind of model",
                     "choose of " + joined(model_kind_names()));
  CalibratedPhysics physics;
  NoiseModel& model = physics.model;
  if (std::ranges::any_of(kinds, needs_bias_frames) || has_frames(input, FrameKind::kBias)) {
    physics = physics_with_format(input, settings, progress);
  } else {
    require_one_gain_unit(input);
    model.sensor = input.sensor;
    model.origin = input.origin;
    model.row_group = input.row_group.value_or(1);
    model.row_group_origin = input.row_group ? "declared" : "assumed";
  }
  warn_of_untold_gain(input, model, progress);
  const FrameFormat* of_physics = model.physics.empty() ? nullptr : &physics.format;
  if (contains(kinds, ModelKind::kGaussian))
    add_gaussian(input, of_physics, settings, progress, model);
  if (contains(kinds, ModelKind::kNonparametric))
    for (MeasuredLevels& levels : measure_gains(input, required_lit_gains(input, "non-parametric"),
                                                of_physics, settings, progress, model))
      model.nonparametric.push_back(std::move(levels.distributions));
  if (contains(kinds, ModelKind::kDarkFrames))
    add_dark_frames(input, physics.format, settings, progress, model);
  warn_of_noise_as_it_shows(model, progress);
  if (!contains(kinds, ModelKind::kPhysics)) {
    keep_warnings_of_physics(model, progress);
    model.physics.clear();
    model.joint.reset();
  }
  if (const std::string contradiction = contradiction_in(model); !contradiction.empty())
    throw InputError(input.origin, "gives a model that contradicts itself: " + contradiction,
                     "check that the frames are what the session says");
  return std::move(model);
}

}  // namespace malus
