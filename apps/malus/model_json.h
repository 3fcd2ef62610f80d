// A noise model as JSON and as text: one home for `model show` and for what `calibrate` prints.
#pragma once

#include "malus/noise/model.h"

#include <string>

#include <nlohmann/json.hpp>

namespace malus::app {

/// The model with the keys that docs/model-file.md names, in the section on JSON; unknown numbers
/// are null.
nlohmann::ordered_json model_json(const NoiseModel& model);

/// What calibration warned about is part of a model, but warnings of the run that measured it.
enum class StoredWarnings { kShown, kLeftOut };

/// Tables for people: one line per gain, then per gain a line per channel, then the laws over gain.
std::string model_text(const NoiseModel& model, StoredWarnings warnings = StoredWarnings::kShown);

/// The model reduced to one gain: the measured entry, or one made from the joint model (frames 0).
/// The other kinds are interpolated, too (dark frames are not); beside physics those that do not
/// know the gain are left out. Throws InputError as NoiseModel::parameters_at.
NoiseModel model_at_gain(const NoiseModel& model, const GainSetting& gain, GainRange range);

}  // namespace malus::app
