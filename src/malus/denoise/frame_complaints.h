// What speaks against a denoised frame, its model or the gain: lines for people, from what
// denoise_frame counted.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/noise/model.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus {

/// Of pixels that are not numbers, saturated ones where they are many, and dark ones that the
/// camera cut off at 0. Without the frame's name. polarized: whether what was made has a DoLP.
/// Contract: dn_above_black has the frame's size; or it is empty, and a network made a picture of
/// `of_picture` pixels, all of them numbers.
std::vector<std::string> frame_complaints(const Denoised& result, bool polarized,
                                          std::int64_t of_picture = 0);

/// That tiles cost much more work than the frame in one piece: their pixels, with what each needs
/// around it, over the frame's; and the memory [MiB] with which there is one. Empty where they cost
/// no more than twice as much.
std::string tile_work_complaint(int tiles, double work, double whole_mib);

/// All that a result tells against its frame, its profile or the network that made it: the lines
/// above, many defects, a stated error of too few pixels, noise that is not the profile's or else a
/// mean that moved. `network` is that one's file, empty where a filter did. `before` needs no
/// pixels.
std::vector<std::string> result_complaints(const RawFrame& before, const Denoised& result,
                                           const NoiseProfile& profile,
                                           const std::string& network = "");

/// That the gain lies outside the calibrated range (profile_at refuses such a gain unless it is
/// asked for), or that the model does not tell its own; empty where neither is so. Without the
/// model's name.
std::string extrapolation_complaint(const NoiseModel& model, const GainSetting& gain);

/// That the model's bias at this gain, or at one that it is interpolated from, is that of dark
/// frames that the camera cut off at 0, the worst channel's; undone: whether the caller works with
/// what it was before.
std::vector<std::string> cut_off_complaints(const NoiseModel& model, const GainSetting& gain,
                                            bool undone);

/// What calibration said at this gain, or at one that it is interpolated from, of a sensor whose
/// rows are read out by two outputs: their own noise stays in the result. Empty or one line.
std::vector<std::string> two_outputs_complaints(const NoiseModel& model, const GainSetting& gain);

/// All that a model tells of itself at a gain: the three above, in their order.
std::vector<std::string> complaints_at_gain(const NoiseModel& model, const GainSetting& gain,
                                            bool undone);

}  // namespace malus
