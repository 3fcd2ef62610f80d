// Heteroscedastic Gaussian noise, variance = slope s + offset, from what other kinds measured. The
// offset is that of a recorded frame, as DNG's NoiseProfile has it: rows and the converter's
// rounding are part of it, whichever way it was measured.
#pragma once

#include "malus/base/estimate.h"
#include "malus/calibrate/nonparametric_calibration.h"
#include "malus/io/dng_noise.h"
#include "malus/noise/model.h"

namespace malus {

/// The photon-transfer line through the dark point, rows and quantisation in the offset. Contract:
/// K and the temporal dark noise were measured.
GaussianCalibration gaussian_of(const PhysicsCalibration& physics);

/// A line through the variances of the signal levels up to highest_dn, weighted by sampling errors
/// that follow from the line itself; row noise goes into the offset. Standard errors grow where the
/// levels scatter about the line by more than sampling. Undecided with fewer than three levels of a
/// channel, or where the variance does not rise above zero.
Estimate<GaussianCalibration> gaussian_of(const MeasuredLevels& levels, double highest_dn);

/// A model of one gain from the NoiseProfile of a DNG frame; quantisation is part of its offset.
/// frame: layout, black, white and gain; pixels are not looked at. InputError where white is not
/// above black.
NoiseModel gaussian_model_of(const DngNoiseProfile& profile, const RawFrame& frame);

}  // namespace malus
