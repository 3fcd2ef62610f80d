// A network package at work on frames of any size: overlapped tiles within a memory limit, batches,
// precision and device. Names no libtorch type.
#pragma once

#include "malus/base/parameter.h"
#include "malus/denoise/denoiser.h"
#include "malus/neural/network_target.h"
#include "malus/synthesize/light_case.h"

#include <filesystem>
#include <memory>
#include <optional>
#include <string>

#include <nlohmann/json.hpp>

namespace malus {

struct InferenceSettings {
  std::string device = "cpu", precision = "float32";
  int tile_batch = 1;
  std::optional<double> ratio;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.device, ParameterInfo{.name = "device",
                                     .unit = "",
                                     .help = "where a network runs",
                                     .choices = {"cpu", "cuda"}});
    field(self.precision,
          ParameterInfo{.name = "precision",
                        .unit = "",
                        .help = "of a network's layers; bfloat16 stays float32 on a CPU that is "
                                "no faster with it (all but AMD's from Zen 4 and Intel's with AMX)",
                        .choices = {"float32", "bfloat16"}});
    field(self.tile_batch,
          ParameterInfo{"tile_batch", "1", "tiles that a network filters at once", 1, 64});
    field(self.ratio,
          ParameterInfo{"ratio", "1", "low-light ratio, for networks that amplify by it",
                        kLeastRatio, kMostRatio});
  }
};

/// A network with its weights, ready for many frames.
class NetworkInference {
 public:
  /// Reads and checks the weight file (package.h). Throws InputError, also where the device is not
  /// there or, on a GPU, the precision not offered for this architecture. bfloat16 stays
  /// float32 on a CPU that is no faster with it, and for widths that its kernels
  /// do not take: description() tells.
  NetworkInference(const std::filesystem::path& weights, const InferenceSettings& settings);
  ~NetworkInference();

  /// As denoise_frame: settings' memory_mib bounds frame and tiles together, row_noise can be
  /// switched off; its method is not looked at. Throws InputError as denoise_frame, on a layout
  /// that the package does not serve (PackageSettings::phase_of), on a strength or profile of its
  /// own, and on a network that gives pictures, or where want_variance is asked of one that
  /// corrects no guide; Cancelled. Corrections of a guide are held to its stated error
  /// (correction_limit.h), which is the variance too.
  Denoised denoise(RawFrame frame, const NoiseProfile& profile, const DenoiseSettings& settings,
                   Progress& progress, bool want_variance = false);

  NetworkTarget target() const;

  /// A picture in place of a mosaic: R, G, B of the frame's size, DN above black of kRgb,
  /// displayed values of about 0..1 of kSrgb. Errors as denoise.
  struct Rendered {
    Planes picture;
    double scale_dn =
        1;            ///< light above black and bias that the network saw (and kSrgb shows) as 1
    Denoised report;  ///< facts about the input, tiles and times; no mosaic
  };
  Rendered render(RawFrame frame, const NoiseProfile& profile, const DenoiseSettings& settings,
                  Progress& progress);

  /// Architecture, settings, parameters, the precision that was taken, tiles and the training
  /// record.
  nlohmann::ordered_json description() const;

 private:
  struct Filtered;
  Filtered filter(RawFrame frame, const NoiseProfile& profile, const DenoiseSettings& settings,
                  Progress& progress);

  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace malus
