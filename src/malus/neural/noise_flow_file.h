// A trained Noise Flow as a noise model of one sensor: its file, and frames drawn from it. Names no
// libtorch type.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/synthesize/exact.h"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus {

/// What weight files and training configurations call it.
inline constexpr const char* kNoiseFlowArchitecture = "noise-flow";

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
  SensorLayout layout() const { return SensorLayout::named(sensor().layout); }
  NoiseFlow& network();
  /// Writes beside the final name and renames. Throws InputError.
  void save(const std::filesystem::path& path, const nlohmann::json& training) const;

  /// Clean mosaic plus noise, in DN above black, nothing rounded or clipped: the variance is that
  /// of the training pairs' noise, their rounding included. NaN and infinities stay what they are,
  /// and are dark to their neighbours. The same seed, frame
  /// and place give the same noise for any number of threads; a crop differs within a few pixels of
  /// its edges, where the couplings' convolutions look beyond it. Throws InputError outside the
  /// trained gains.
  Image draw(View<const float> clean_dn, const GainSetting& gain, const DrawAddress& address);
  /// As the camera would write it: black added, rounded to the pairs' step, clipped at 0 and white;
  /// NaN becomes 0. What the training
  /// pairs' rounding put into the noise is taken out before; it comes back with this one.
  RawFrame draw_raw(View<const float> clean_dn, const GainSetting& gain,
                    const DrawAddress& address);

  /// The gain as the network takes it: natural logarithm of its factor.
  static double log_gain(const GainSetting& gain);
  /// DN of the network's unit.
  double scale_dn() const;

 private:
  /// draw() with the noise's variance narrowed by excess_dn2.
  Image narrowed(View<const float> clean_dn, const GainSetting& gain, const DrawAddress& address,
                 double excess_dn2);
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace malus
