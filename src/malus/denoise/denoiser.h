// Raw frame in, denoised raw frame out: the methods by name, and what every one of them tells about
// its work.
//   measure what the camera cut off at 0 -> fill defects -> subtract black and bias -> take out
//   fixed pattern, row and column noise -> fill impulses -> stabilise the variance -> filter ->
//   exact unbiased inverse -> mosaic
// docs/denoising.md has these steps as a table.
#pragma once

#include "malus/base/parameter.h"
#include "malus/base/progress.h"
#include "malus/denoise/denoise_profile.h"
#include "malus/denoise/noise_check.h"
#include "malus/image/raw_frame.h"
#include "malus/noise/profile.h"

#include <optional>
#include <string>
#include <vector>

namespace malus {

struct DenoiseSettings {
  std::string method = "nl-ridge";
  std::string profile = "normal";
  double memory_mib = 1024;
  double strength = 1.0;
  bool row_noise = true;
  bool column_noise = true;
  bool defects = true;
  bool fixed_pattern = true;
  bool like_pixels = true;
  /// What the caller holds besides while it denoises, in float32 values: it counts in memory_mib.
  double held_values = 0;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.method, ParameterInfo{"method", "", "nl-ridge (the default), bm3d or a baseline"});
    field(self.profile, ParameterInfo{.name = "profile",
                                      .unit = "",
                                      .help = "speed against quality",
                                      .choices = denoise_profile_names()});
    field(self.memory_mib,
          ParameterInfo{"memory", "MiB", "frames and tiles together take no more than this", 128,
                        1 << 20});
    field(self.strength, ParameterInfo{"strength", "1",
                                       "multiplies the noise deviation that is taken out", 0.1, 4});
    field(self.row_noise,
          ParameterInfo{"row_noise", "",
                        "estimate and remove the row noise first (not of baselines)"});
    field(self.column_noise,
          ParameterInfo{"column_noise", "",
                        "the same of the column noise, where the model's is significant (not of "
                        "baselines)"});
    field(self.defects,
          ParameterInfo{"defects", "",
                        "fill the model's defect pixels from their neighbours, in frames of the "
                        "sensor's whole size or of known place on it, and single pixels that the "
                        "tails of its read noise explain"});
    field(self.fixed_pattern,
          ParameterInfo{"fixed_pattern", "",
                        "take out what the frame shows of the model's dark shading and PRNU maps, "
                        "in frames of the sensor's whole size or of known place on it, and count "
                        "what is left of PRNU and DSNU as noise"});
    field(
        self.like_pixels,
        ParameterInfo{"like_pixels", "",
                      "average pixels once more where the result says that they are alike, as "
                      "in print; without it faint marks on print stay clearer (not of baselines)"});
  }
};

struct StageTime {
  std::string stage;
  double seconds = 0;
};

struct Denoised {
  Image dn_above_black;  ///< mosaic, size of the input, bias removed, nothing clamped
  /// Expected squared error of every pixel, if asked for. NaN where nothing is known of it: of
  /// saturated pixels and of those that are not numbers.
  std::optional<Image> variance_dn2;
  std::vector<double> sigma_used_dn;
  double row_noise_removed_dn = 0, column_noise_removed_dn = 0;
  std::vector<double> mean_dn;
  /// Filters keep means: where it moves, the noise was not what the profile says.
  std::vector<double> mean_shift_dn;
  std::int64_t nonfinite_pixels = 0;  ///< light_range tells which hold light
  std::int64_t saturated_pixels = 0;
  double cut_off_share = 0;         ///< cut_off.h
  double frames_cut_off_share = 0;  ///< of a mean of frames: cut_off_share_of_mean
  /// This needs noise of half a step or more, a method that stabilises, and of a network a
  /// stabilised domain.
  bool cut_off_undone = false;
  std::int64_t defect_pixels = 0;
  std::int64_t impulse_pixels = 0;  ///< impulses.h
  std::int64_t kept_pixels = 0;     ///< kept_points.h
  double dark_pattern_share = 0, response_pattern_share = 0;
  std::optional<NoiseCheck> noise;  ///< the frame's own against the profile's
  int tiles = 1;
  double tile_work = 1;
  std::vector<StageTime> times;

  /// What is told of every frame: JSON, Python and its help come from here.
  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.sigma_used_dn,
          ParameterInfo{"sigma_used_dn", "DN",
                        "noise deviation at the channel's mean signal, per channel"});
    field(self.row_noise_removed_dn,
          ParameterInfo{"row_noise_removed_dn", "DN", "root mean square over the row groups"});
    field(self.column_noise_removed_dn,
          ParameterInfo{"column_noise_removed_dn", "DN", "root mean square over the columns"});
    field(self.mean_dn,
          ParameterInfo{"mean_dn", "DN", "of the frame above black and bias, per channel"});
    field(self.mean_shift_dn,
          ParameterInfo{"mean_shift_dn", "DN", "the result's mean minus that, per channel"});
    field(self.nonfinite_pixels,
          ParameterInfo{"nonfinite_pixels", "1",
                        "pixels that hold no light, NaN and infinite ones among them; kept"});
    field(self.saturated_pixels, ParameterInfo{"saturated_pixels", "1", "pixels at white"});
    field(self.cut_off_share,
          ParameterInfo{"cut_off_share", "1", "of the pixels, those at 0 that noise took there"});
    field(self.cut_off_undone, ParameterInfo{"cut_off_undone", "",
                                             "whether the law of what was cut off was taken back"});
    field(self.defect_pixels,
          ParameterInfo{"defect_pixels", "1", "of the model's list, filled from neighbours"});
    field(self.impulse_pixels,
          ParameterInfo{"impulse_pixels", "1", "of the read noise's tails, filled too"});
    field(self.kept_pixels,
          ParameterInfo{"kept_pixels", "1", "pixels that the noise does not explain, put back"});
    field(self.dark_pattern_share,
          ParameterInfo{"dark_pattern_share", "1",
                        "dark shading taken out, in units of the model's map; 0: none shows"});
    field(self.response_pattern_share,
          ParameterInfo{"response_pattern_share", "1", "the same of PRNU"});
    field(self.tiles, ParameterInfo{"tiles", "1", "parts that the frame was denoised in"});
    field(self.tile_work,
          ParameterInfo{"tile_work", "1",
                        "their pixels, with what each needs around it, over the frame's"});
  }
};

/// What a method's last pass over the mosaic does with similar blocks; kNone: a baseline, which
/// filters planes.
enum class MosaicFilter { kNone, kWiener, kRidge };

struct DenoiseMethod {
  std::string name;
  std::string description;  ///< one line
  MosaicFilter filter;
  /// By the noise's law, which takes back what was cut off at 0. Others filter the pixels as given.
  bool stabilizes = true;

  /// Takes out row and column noise, gives variances; baselines do not.
  bool on_mosaic() const { return filter != MosaicFilter::kNone; }
};
/// The built-in methods, the default first.
const std::vector<DenoiseMethod>& denoise_methods();
/// Throws InputError that names the nearest method, and networks' files as what malus denoise
/// takes: this library runs none. A caller that does says so in `also`: what it takes besides.
const DenoiseMethod& denoise_method(const std::string& name, const std::string& also = "");

/// The frame is taken by value: its pixels become working memory. `profile` is that of
/// frame_profile (denoise/frame_profile.h), which takes it from a model, or of estimate_noise
/// (denoise/estimate_noise.h); it has the frame's layout, its bias is subtracted, its defects are
/// filled, its fixed pattern is taken out. Pixels that hold no light (light_range) are filled from
/// their neighbours for the filter's sake and come back as they are, above black.
/// Float pixels (bits 0) are saturated at white where white_known says so, else where they pile up.
/// Throws InputError on an unknown method or profile name, an empty frame, a layout that differs
/// from the profile's, black levels that are not one per channel, a white that is not above black
/// or out of all range, settings out of their range, or too little memory; Cancelled.
/// progress is warned of much work of small tiles before that begins.
Denoised denoise_frame(RawFrame frame, const NoiseProfile& profile, const DenoiseSettings& settings,
                       Progress& progress = silent_progress(), bool want_variance = false);

}  // namespace malus
