// What a converter's whole numbers are multiples of.
#pragma once

#include "malus/image/view.h"

#include <optional>
#include <span>
#include <vector>

namespace malus {

/// The converter's step: greatest common divisor of the differences between a frame's values (16
/// for 12 bits stored in the upper part of 16); 0 for fractional values, where all are equal and
/// where there are none.
double quantization_step(View<const float> dn);

/// The same of some pixels.
double quantization_step(std::span<const float> pixels_dn);

/// Mean distance of the codes in use among the middle half of these pixels of one channel: above
/// the step where a camera compands (square-root coding, lossy raw). 0 where the half holds one
/// code, or fewer than 20 pixels per unit of its extent: too few to use every code.
double code_spacing(std::vector<float> pixels_dn);

/// The same of narrow noise, which most of the pixels' few codes hold: mean distance of the codes
/// in use from the first to the last that 20 of these pixels have, the outer twentieths left out. 0
/// from fewer than three such codes.
double occupied_spacing(std::vector<float> pixels_dn);

/// A code that none of these pixels has, though both its neighbours have many of them (a twentieth
/// and a hundred at least), as where a converter leaves codes out; of several the one between the
/// most pixels. step: of the codes; none where it is 0.
std::optional<double> left_out_code(std::vector<float> pixels_dn, double step);

}  // namespace malus
