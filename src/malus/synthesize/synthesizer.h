// Noisy frames of one camera from clean ones: a noise model, a gain and the pipeline around them
// (000 section 5.1).
//
//   clean / ratio -> noise at a gain -> camera: black, rounding, clipping -> minus black and global
//   bias (debias) -> times ratio (amplify)
#pragma once

#include "malus/base/parameter.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/model.h"
#include "malus/synthesize/compiled.h"
#include "malus/synthesize/gain_tables.h"
#include "malus/synthesize/level_coverage.h"
#include "malus/synthesize/light_case.h"
#include "malus/synthesize/synthesis_kind.h"

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

struct SynthesisSettings {
  std::string kind = "physics";
  std::string parameters = "sampled";
  double ratio = 1;
  bool amplify = false, debias = false;
  bool shot = true, read = true, row = true, quantization = true, bias = true;
  bool exact = false, extrapolate_gain = false;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    const double infinity = std::numeric_limits<double>::infinity();
    field(self.kind, ParameterInfo{"kind",
                                   "",
                                   "noise model",
                                   -infinity,
                                   infinity,
                                   {kSynthesisKindNames.begin(), kSynthesisKindNames.end()}});
    field(
        self.parameters,
        ParameterInfo{"parameters",
                      "",
                      "physics: draw mu, sigma_b, sigma_TL anew for every frame (000 Eq. 5-6), or "
                      "use their means",
                      -infinity,
                      infinity,
                      {"sampled", "mean"}});
    field(self.ratio,
          ParameterInfo{"ratio", "1", "low-light ratio: the clean signal is divided by it",
                        kLeastRatio, kMostRatio});
    field(self.amplify, ParameterInfo{"amplify", "",
                                      "multiply the result by the ratio again; the black level of "
                                      "integers with it, so that noise is not cut off at 0"});
    field(self.debias,
          ParameterInfo{"debias", "",
                        "take the global bias away, as 000 does before training: mu is "
                        "drawn around its mean minus the mean over the channels"});
    field(self.shot, ParameterInfo{"shot", "", "shot noise"});
    field(self.read, ParameterInfo{"read", "", "read noise"});
    field(self.row, ParameterInfo{"row", "", "row noise"});
    field(self.quantization, ParameterInfo{"quantization", "", "quantisation noise"});
    field(self.bias, ParameterInfo{"bias", "", "channel-wise bias mu"});
    field(self.exact, ParameterInfo{"exact", "",
                                    "the plain definition instead of the compiled "
                                    "sampler (slow; physics only)"});
    field(self.extrapolate_gain,
          ParameterInfo{"extrapolate_gain", "", "allow gains outside the calibrated range"});
  }
};

/// What a frame was drawn with.
struct FrameParameters {
  GainSetting gain;
  PhysicsNoise physics;       ///< of kinds physics, poisson-gaussian and dark-frames; else empty
  double global_bias_dn = 0;  ///< what debias took away
  LevelCoverage coverage;     ///< of kind nonparametric; else empty
};

struct SyntheticFrame : FrameParameters {
  Image dn;  ///< DN above black, unrounded
};

/// A gain that the kind can be drawn at: of physics NoiseModel::random_gain (000: uniform in log K
/// over the calibrated range); of kinds gaussian and nonparametric uniform in dB over their own
/// gains; of dark frames, which are not interpolated, one that has them. Throws InputError where
/// the model lacks the kind.
GainSetting random_gain(const NoiseModel& model, const SynthesisSettings& settings,
                        std::uint64_t seed, std::uint32_t frame);

/// Tables are made at the first draw of a gain and kept for the gains drawn last. Safe to use from
/// several threads; copies share their tables.
class Synthesizer {
 public:
  /// Throws InputError on settings out of their range or choices, when the model lacks the kind,
  /// and where a setting means nothing to it. Maps make a model large: one that is drawn from with
  /// several settings is shared, not copied. Contract: not null.
  Synthesizer(std::shared_ptr<const NoiseModel> model, SynthesisSettings settings);
  Synthesizer(NoiseModel model, SynthesisSettings settings);

  /// clean_dn: mosaic in DN above black at the frame's gain, whose first pixel lies at
  /// address.row0, address.col0 of the sensor. gain: empty = random_gain. Result before rounding:
  /// DN above black, with uniform quantisation noise; debiased and amplified as set. InputError on
  /// gains that the model cannot serve.
  SyntheticFrame draw(View<const float> clean_dn, const std::optional<GainSetting>& gain,
                      const DrawAddress& address) const;

  /// The same into the caller's memory, which may be the clean mosaic itself; nothing the size of
  /// the frame is allocated. Contract: equal sizes.
  FrameParameters draw_into(View<const float> clean_dn, View<float> noisy_dn,
                            const std::optional<GainSetting>& gain,
                            const DrawAddress& address) const;

  /// The same as the camera would write it: rounded and clipped DN, black included, no uniform
  /// quantisation noise. With debias the bias goes into the frame's black level, fraction and all.
  /// amplify acts on the rounded values, and the result is rounded again; white moves along. Where
  /// it multiplies, black is multiplied too (to 16384 at most), so that noise below it is not cut
  /// off at 0. drawn, if given, gets what draw_into returns.
  RawFrame draw_raw(View<const float> clean_dn, const std::optional<GainSetting>& gain,
                    const DrawAddress& address, const std::vector<double>& black_dn,
                    double white_dn, FrameParameters* drawn = nullptr) const;

  /// Throws InputError on a gain that draws refuse; makes its tables, which they need anyway.
  void require_gain(const GainSetting& gain) const;

  /// The address of a patch of rows x cols pixels that belongs to no place of its own. Only kind
  /// dark-frames has places: it gets one anywhere in the dark frames that begins a cell and a row
  /// group, a function of seed and frame. Row and column 0 of other kinds.
  DrawAddress somewhere(int rows, int cols, std::uint64_t seed, std::uint32_t frame) const;

  /// One line where frames of rows x cols pixels are larger than the dark frames that fill them;
  /// empty elsewhere and of other kinds.
  std::string repetition(int rows, int cols) const;

  const NoiseModel& model() const { return *model_; }
  const SynthesisSettings& settings() const { return settings_; }

 private:
  FrameParameters noisy(View<const float> clean_dn, View<float> noisy_dn,
                        const std::optional<GainSetting>& gain, const DrawAddress& address,
                        bool rounded_later) const;
  FrameParameters physical(const GainTables& tables, View<const float> signal_dn,
                           View<float> noisy_dn, const DrawAddress& address,
                           bool rounded_later) const;
  std::shared_ptr<const GainTables> tables_at(const GainSetting& gain) const;
  GainTables make_tables(const GainSetting& gain) const;

  std::shared_ptr<const NoiseModel> model_;
  SynthesisSettings settings_;
  std::shared_ptr<GainTableCache> cache_;
  SynthesisKind kind_ = SynthesisKind::kPhysics;  ///< settings_.kind
};

/// Rounds to the camera's step with black back, and clips to 0..white; NaN becomes 0. In place: DN
/// above black -> raw DN. row0, col0 place the view in the mosaic.
void round_as_camera(View<float> dn, const SensorLayout& layout, const CameraOutput& camera,
                     int row0 = 0, int col0 = 0);

}  // namespace malus
