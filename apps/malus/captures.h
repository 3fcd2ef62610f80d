// Captured pairs as experiments use them: those that `malus pairs` wrote, or frames of a simulated
// camera written the same way; and how near a network's picture of one comes to its reference.
#pragma once

#include "malus/base/progress.h"
#include "malus/io/pair_list.h"
#include "malus/noise/model.h"

#include <filesystem>
#include <string>
#include <vector>

#include "denoise_method.h"

namespace malus::app {

/// The pairs of all lists, looked at before any work is done: throws InputError, naming list or
/// frame, where a list cannot be read or holds none, where a frame is missing, no mosaic or
/// denoised, where the two of a pair differ in size or layout, and with a model where they are of
/// another sensor's layout or at gains that it does not know. gains: others of the lists are left
/// out unseen; none: all are taken.
std::vector<RecordedPair> open_pairs(const std::vector<std::filesystem::path>& lists,
                                     const NoiseModel* model,
                                     const std::vector<GainSetting>& gains = {});

/// Those at a gain; throws InputError, naming the list, where there are none.
std::vector<RecordedPair> captures_at(const std::vector<RecordedPair>& captures,
                                      const GainSetting& gain, const std::filesystem::path& list);

/// How a simulated camera takes pictures.
struct CameraShot {
  GainSetting gain;
  double ratio = 1;     ///< low-light ratio
  double exposure = 1;  ///< of the pictures' light, before the ratio
  int crop = 512;       ///< middle part of the pictures
};
/// One frame of each picture with the mean parameters of the camera's physics noise, its clean
/// mosaic and its colours, in folder; the same seed gives the same frames. Throws InputError.
std::vector<RecordedPair> take_pictures(const NoiseModel& camera,
                                        const std::vector<std::filesystem::path>& pictures,
                                        const CameraShot& shot, const std::filesystem::path& folder,
                                        std::uint64_t seed, Progress& progress);

/// The short frame as the camera wrote it, at the list's gain; with a model as frames that are
/// denoised are read: levels that the file does not tell are the model's. Throws InputError, also
/// where the file tells another gain than the list.
RawFrame load_short(const RecordedPair& capture, const NoiseModel* model);
/// The reference as its file holds it: DN above black, at its own light. Throws InputError, also
/// where it is not of the short frame's size and layout.
RawFrame load_reference(const RecordedPair& capture, const RawFrame& noisy);

/// A capture's frames.
struct LoadedCapture {
  RawFrame noisy;  ///< as the camera wrote it, black included
  Image clean_dn;  ///< DN above black, at the noisy frame's light
};
/// kKnown: NaN where the reference does not tell the light (mark_unknown,
/// malus/synthesize/pairs.h), for comparisons of noise.
enum class ReferenceLight { kAsItIs, kKnown };
LoadedCapture load_capture(const RecordedPair& capture, const NoiseModel& model,
                           ReferenceLight light = ReferenceLight::kAsItIs);
/// R, G, B at the noisy frame's light: the capture's picture, else the clean mosaic demosaicked.
Planes reference_colors(const RecordedPair& capture, const LoadedCapture& loaded,
                        const NoiseModel& model);

/// Divergence of made noise from the captured one: of frames less their clean mosaics, all captures
/// together whose scene has a made frame, of which the one of the nearest light counts. Floors:
/// what two samples of one distribution have.
struct NoiseDivergence {
  double jsd = 0, jsd_floor = 0, sqrt_jsd = 0, sqrt_jsd_floor = 0;
  int captures = 0;
};
NoiseDivergence divergence(const std::vector<RecordedPair>& made,
                           const std::vector<RecordedPair>& captured, const NoiseModel& model);

/// Sums over captures.
struct PictureScore {
  double psnr_db = 0, ssim = 0, seconds = 0;
  int count = 0;
};
/// Adds how near the picture comes that the denoiser makes of the capture: a network's own (as
/// displayed of kSrgb, at its own exposure), else the denoised mosaic demosaicked, else, without
/// a denoiser, the noisy one. Peak is white of the reference's exposure, or of the display.
void add_to_score(PictureScore& score, const RecordedPair& capture, const NoiseModel& model,
                  const FrameDenoiser* denoiser);

}  // namespace malus::app
