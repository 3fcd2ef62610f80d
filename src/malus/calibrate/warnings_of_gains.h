// What a calibration warned about, in the words in which users are told.
#pragma once

#include "malus/noise/model.h"

#include <string>
#include <vector>

namespace malus {

/// What the calibration of single gains warned about, all kinds of models; gains that were warned
/// of in the same words share a line: "0 dB, 12 dB, Gaussian: ...".
std::vector<std::string> warnings_of_gains(const NoiseModel& model);

}  // namespace malus
