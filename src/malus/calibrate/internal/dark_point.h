// The point without light of a photon-transfer line.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/cut_off_noise.h"
#include "malus/calibrate/internal/photon_transfer.h"
#include "malus/calibrate/internal/rounded_noise.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// Of one channel. variance_dn2: temporal, of the bias frames, whose row noise and residuals `bias`
/// holds.
DarkPoint dark_point(int channel, const MosaicGeometry& geometry, double variance_dn2,
                     const PhysicsCalibration& bias);

/// Rounding gives narrow noise any variance from 0 to a quarter of q², and wide noise q²/12 more
/// than its own: what the flats hold is not what was measured in the dark. Into the dark point, and
/// what is subtracted from the levels: where the step hides the noise of a level's own dark frames,
/// too, this and the shot noise of their dark current, by their level. Levels whose own noise is as
/// narrow are refused where enough others are not. Of noise that is little wider: the error of not
/// knowing its place in a code.
void take_hidden_noise(const HiddenNoise& hidden, DarkPoint& dark,
                       std::vector<TransferLevel>& levels);

/// The same of noise that the camera cuts off: as it was before. zero_share: of the bias
/// frames; dark frames of a level's own lost as much less as they have fewer zeros (dark current
/// lifts them off the floor; lowest_dn: that floor, as the files have it). Levels that are cut off
/// themselves are refused where enough others are not.
void take_cut_off(const CutOffNoise& cut, double zero_share, double lowest_dn, DarkPoint& dark,
                  std::vector<TransferLevel>& levels);

/// Into dark_point of `out`, once per channel, in their order.
void append_dark_point(const DarkPoint& dark, PhysicsCalibration& out);

/// temporal_sd_dark squared into dark_point of `out`, which is filled or empty, for the channels
/// whose noise the step does not hide. To be called when temporal_sd_dark is final.
void settle_dark_points(const std::vector<HiddenNoise>& hidden, PhysicsCalibration& out);

}  // namespace malus
