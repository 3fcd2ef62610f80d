// What of a sensor's frames stays the same from one to the next.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/image/view.h"

#include <memory>
#include <vector>

namespace malus {

struct NoiseModel;
struct NoiseProfile;

/// Maps of the whole sensor at one gain; either may be empty. Where the columns of a map differ by
/// more than chance has it of their pixels, what they have in common is kept apart, since many
/// pixels tell it, and a frame may show one without the other.
struct FixedPattern {
  Image dark_dn;   ///< mosaic: dark signal above the channel's mean; 0 at defects
  Image response;  ///< mosaic: response to light relative to the neighbours'; 1 at defects
  /// To be added to the maps: a row for every row of the cell, each column's value for its channel.
  Image dark_columns_dn = {}, response_columns = {};
  /// Of what was measured, the part that is the sensor's: the rest, sampling error, is taken out. A
  /// frame of which the maps were made, which has its own noise in common with them, seems to hold
  /// them as often as the inverse of this says.
  double dark_kept = 1, response_kept = 1, dark_columns_kept = 1, response_columns_kept = 1;
  /// Of a map's variance without its sampling error, what its columns and smooth shading have.
  struct Shares {
    double columns = 0, smooth = 0;
  } dark_shares = {}, response_shares = {};
};

/// The maps of the measured gain nearest to `gain` (of the first one where no gain is named), each
/// of the nearest that has it; null where the model holds none. Of ordinary pixels their sampling
/// error's share, as DSNU and PRNU tell it, is taken away (Wiener), of outliers less; of columns
/// that of a mean over their pixels, apart from what is smooth along the rows; of dark shading that
/// is smooth in both directions that of a median of many. Contract: no contradiction_in(model).
std::shared_ptr<const FixedPattern> fixed_pattern_at(const NoiseModel& model,
                                                     const GainSetting& gain);

/// By how much the pixels of a channel differ: their response, relative, and their dark signal.
struct PatternDeviation {
  double prnu = 0, dsnu_dn = 0;
};

/// Of every channel, each of the measured gain nearest to `gain` that has it, the dark signal's in
/// proportion to K, which the profile tells of `gain`; 0 where the model holds none. Contract: no
/// contradiction_in(model), a profile of its layout.
std::vector<PatternDeviation> pattern_deviations_at(const NoiseModel& model,
                                                    const GainSetting& gain,
                                                    const NoiseProfile& profile);

/// In a single frame such differences are noise like any other, but the same in every frame: the
/// channels' variances and laws with them. The profile stays as it is, to the bit, where they are
/// 0. Contract: one per channel, of which the profile has none yet.
void add_pattern_noise(NoiseProfile& profile, const std::vector<PatternDeviation>& deviations);

/// Values in the maps of all gains; and what forgets the maps, where no frame will need them.
double map_values(const NoiseModel& model);
void drop_maps(NoiseModel& model);

}  // namespace malus
