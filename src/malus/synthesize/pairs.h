// Training pairs from captured frames (000 section 4): the reference is the mean of many long
// exposures, and of the few short ones the frame is kept whose intensity is nearest to reference /
// ratio, because lamps flicker.
#pragma once

#include "malus/base/estimate.h"
#include "malus/image/frame_mean.h"
#include "malus/image/raw_frame.h"
#include "malus/image/view.h"
#include "malus/noise/model.h"
#include "malus/noise/profile.h"

#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace malus {

/// Light of a short frame against a reference.
struct RelativeIntensity {
  double value = 0;  ///< the factor
  /// What the rows of each band of the frame take it off, from the top; their sum is 0.
  std::vector<double> of_bands{};
};

/// The factor f that makes f * reference fit the frame in the least-squares sense over pixels whose
/// reference lies in (low_dn, high_dn); both above black. NaN pixels are left out. Undecided with
/// fewer than 100 such pixels.
Estimate<RelativeIntensity> relative_intensity(View<const float> short_dn,
                                               View<const float> reference_dn, double low_dn,
                                               double high_dn);

/// Share of a reference's pixels at 98 % of white or beyond: white cuts them off, in some of its
/// frames at least, and they are darker than the scene. white_dn: above black, like the reference.
double clipped_share(View<const float> reference_dn, double white_dn);

/// White above black of a reference at its own light, as its file tells it, else that of its short
/// frame, which is of the same camera; nothing where neither does.
std::optional<double> white_of_reference(const RawFrame& reference, const RawFrame& short_frame);
/// Else that of the camera's model.
double white_of_reference(const RawFrame& reference, const RawFrame& short_frame,
                          const NoiseModel& model);
/// As its file tells it, else the camera's.
double white_of_reference(const RawFrame& reference, double camera_white_above_black_dn);

/// Makes those pixels of a reference NaN that do not tell the light of its scene: the ones that
/// clipped_share counts, and defects where their list is of a sensor of this size. Returns how many
/// pixels are no finite numbers then.
std::int64_t mark_unknown(Image& reference_dn, double white_dn, const DefectList& defects = {});

/// What a pair's noisy frame should show: the reference over the low-light ratio; DN above black
/// and bias. bias_at: the gain whose bias the reference still holds, if any; the model tells it,
/// and without one (null) it stays. Contract: the model is of the layout of the mosaic; ratio > 0.
/// Throws InputError as NoiseModel::profile_at.
Image light_of_reference(Image reference_dn, double ratio, const NoiseModel* model = nullptr,
                         const std::optional<GainSetting>& bias_at = std::nullopt,
                         GainRange range = GainRange::kCalibratedOnly);

/// Asks a model for the gains of pairs, each of them once.
class KnownGains {
 public:
  explicit KnownGains(const NoiseModel& model, GainRange range = GainRange::kCalibratedOnly)
      : model_(model), range_(range) {}
  /// Throws InputError, with what the gain is of, where the model does not know it.
  void require(const GainSetting& gain, const std::string& of);

 private:
  const NoiseModel& model_;
  GainRange range_;
  std::vector<GainSetting> known_;
};

/// How much more DN a camera makes of the same light at one gain than at another, by the K of a
/// model's profiles (means over the channels), which knows of conversion gains and of ISO. Nothing
/// where a profile does not hold K.
std::optional<double> gain_ratio(const NoiseProfile& one, const NoiseProfile& other);
/// The same by the decibels; 1 where one of the gains is not told in them.
double gain_ratio(const GainSetting& one, const GainSetting& other);

struct NearestFrame {
  std::size_t index = 0;
  double deviation = 0;  ///< intensity * ratio - 1 of the chosen frame
  /// (largest - smallest) / mean of the candidates' intensities; none where they hold no light, of
  /// one candidate, and where it is no more than noise makes.
  std::optional<double> flicker;
  /// What noise alone makes of that in next to no session: three standard errors of the difference
  /// of two, more of several. Its size is that of what the candidates' bands differ by; none where
  /// they are of fewer than two bands, of one candidate, and where they hold no light.
  std::optional<double> flicker_of_noise;
};

/// The candidate whose intensity is nearest to 1/ratio. Contract: candidates not empty and of one
/// size, ratio > 0.
NearestFrame nearest_frame(const std::vector<RelativeIntensity>& intensities, double ratio);

}  // namespace malus
