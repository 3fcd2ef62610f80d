// A trained Noise Flow as a noise model of one sensor: its file, frames drawn from it, and what
// their noise is. Names no libtorch type.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"
#include "malus/synthesize/exact.h"

#include <filesystem>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus {

/// What weight files and training configurations call it.
inline constexpr const char* kNoiseFlowArchitecture = "noise-flow";

/// What stands where a calibrated model has its sensor's name.
inline constexpr const char* kNoiseFlowCamera = "Noise Flow";

/// Whether a file that is named in place of a calibrated model is a Noise Flow, by its ending.
inline bool names_noise_flow(const std::filesystem::path& model) {
  return model.extension() == ".safetensors";
}

class NoiseFlow;

/// What belongs to the sensor, stored beside the weights.
struct NoiseFlowSensor {
  std::string layout;
  std::vector<double> black_dn;                    ///< nominal, per channel
  double white_dn = 0;                             ///< black included
  double lowest_gain_db = 0, highest_gain_db = 0;  ///< of the training pairs
  /// The step q of the noisy frames, where all training pairs had integers: training spreads them
  /// over ±q/2, so the network's noise is theirs and q²/12 more, and draws are narrowed by it. 0 of
  /// other pairs.
  double spread_dn = 0;
  /// Of the training pairs, rising, as 20 log10(ISO / 100) where they were given in ISO; of files
  /// that do not tell them, the lowest and the highest.
  std::vector<double> gains_db = {};
  bool gains_in_iso = false;

  /// The number as a setting in the unit of the training pairs: ISO, or dB.
  GainSetting setting_of(double gain) const {
    return gains_in_iso ? GainSetting{.gain_db = {}, .iso = gain}
                        : GainSetting{.gain_db = gain, .iso = {}};
  }
  /// Those of the training pairs.
  std::vector<GainSetting> trained_gains() const {
    std::vector<GainSetting> gains;
    for (const double db : gains_db.empty() ? std::set{lowest_gain_db, highest_gain_db}
                                            : std::set(gains_db.begin(), gains_db.end()))
      gains.push_back(GainSetting::at_decibel(db, gains_in_iso));
    return gains;
  }
  /// Throws InputError where the gain is not known, in another unit than the trained ones (a file
  /// that does not tell its gains does not tell that) or outside of them.
  void require_gain(const GainSetting& gain) const;
};

class NoiseFlowModel {
 public:
  /// Reads and checks a weight file with architecture "noise-flow". Throws InputError.
  explicit NoiseFlowModel(const std::filesystem::path& path);
  NoiseFlowModel(NoiseFlowSensor sensor, std::int64_t steps, std::int64_t width);
  ~NoiseFlowModel();
  NoiseFlowModel(NoiseFlowModel&&) noexcept;
  NoiseFlowModel& operator=(NoiseFlowModel&&) noexcept;

  const NoiseFlowSensor& sensor() const;
  /// The name of the camera that it stands for, another one of every flow.
  std::string camera_name() const;
  SensorLayout layout() const { return SensorLayout::named(sensor().layout); }
  NoiseFlow& network();
  /// What save() was told of the training; null of a model that was not read from a file.
  const nlohmann::json& training() const;
  /// Writes beside the final name and renames. Throws InputError.
  void save(const std::filesystem::path& path, const nlohmann::json& training) const;

  /// Clean mosaic plus noise, in DN above black, nothing rounded or clipped: the variance is that
  /// of the training pairs' noise, their rounding included. NaN and infinities stay what they are,
  /// and are dark to their neighbours. The same seed, frame
  /// and place give the same noise for any number of threads; a crop differs within a few pixels of
  /// its edges, where the couplings' convolutions look beyond it. Throws InputError outside the
  /// trained gains.
  Image draw(View<const float> clean_dn, const GainSetting& gain, const DrawAddress& address) const;
  /// As the camera would write it: black added, rounded to the pairs' step, clipped at 0 and white;
  /// NaN becomes 0. What the training
  /// pairs' rounding put into the noise is taken out before; it comes back with this one.
  RawFrame draw_raw(View<const float> clean_dn, const GainSetting& gain,
                    const DrawAddress& address) const;
  /// As the training pairs were: draw_raw() where they were integers, else draw() and black, held
  /// to white, neither rounded nor cut off at 0.
  RawFrame draw_as_recorded(View<const float> clean_dn, const GainSetting& gain,
                            const DrawAddress& address) const;

  /// The noise of draw() at a gain as a denoiser or a network wants it, measured on draws of
  /// uniform light, each channel by itself: the bias without light, and the variance at
  /// kProfileLevels signals up to white (1 % of it, from kProfileSamples pixels each). Rows are
  /// part of the pixels' noise, whose shape counts as normal. Measured once for every gain. Any
  /// thread. Throws InputError outside the trained gains.
  NoiseProfile profile_at(const GainSetting& gain) const;
  static constexpr int kProfileLevels = 21;
  static constexpr int kProfileSamples = 128 * 128;

  /// The gain as the network takes it: natural logarithm of its factor.
  static double log_gain(const GainSetting& gain);
  /// DN of the network's unit.
  double scale_dn() const;

 private:
  /// draw() with the noise's variance narrowed by excess_dn2.
  Image narrowed(View<const float> clean_dn, const GainSetting& gain, const DrawAddress& address,
                 double excess_dn2) const;
  NoiseProfile measured_profile(const GainSetting& gain) const;
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace malus
