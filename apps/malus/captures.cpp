#include "captures.h"

#include "malus/base/error.h"
#include "malus/base/index.h"
#include "malus/base/stopwatch.h"
#include "malus/denoise/frame_profile.h"
#include "malus/evaluate/evaluation.h"
#include "malus/evaluate/noise_comparison.h"
#include "malus/image/middle.h"
#include "malus/io/frame_file.h"
#include "malus/io/picture_file.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/same_sensor.h"
#include "malus/polar/color_map.h"
#include "malus/polar/demosaick.h"
#include "malus/synthesize/pairs.h"
#include "malus/synthesize/scene.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "frame_contents.h"
#include "frame_input.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

void save_floats(const fs::path& path, const Planes& planes,
                 const std::vector<std::string>& names) {
  SaveOptions save;
  save.force = true;
  save.type = SampleType::kFloat;
  save_picture(path, planes, names, save);
}

// Middle of a picture as R, G, B light in DN above black.
Planes clean_light(const fs::path& path, const NoiseModel& camera, const CameraShot& shot) {
  const Picture picture = load_clean_picture(path);
  const Planes light = checked_light(picture, path.string(), picture.bits > 0);
  const double white = white_above_black(camera.white_dn, camera.black_dn);
  Planes middle(3, 0, 0);
  for (int k = 0; k < 3; ++k) {
    middle[k] = middle_of(light[light.channels() == 3 ? k : 0], camera.layout, shot.crop);
    for (float& v : middle[k].values())
      v = static_cast<float>(std::min(static_cast<double>(v) * shot.exposure, 1.0) * white);
  }
  return middle;
}

// The made frame of a captured one's scene whose light is nearest; null where there is none.
const RecordedPair* counterpart(const std::vector<RecordedPair>& made,
                                const RecordedPair& captured) {
  const RecordedPair* nearest = nullptr;
  double least = std::numeric_limits<double>::infinity();
  for (const RecordedPair& pair : made) {
    const double distance = std::abs(std::log(pair.ratio / captured.ratio));
    if (pair.scene() != captured.scene() || distance >= least) continue;
    nearest = &pair;
    least = distance;
  }
  return nearest;
}

void require_pair(const RecordedPair& pair, const RawFrame& reference, const RawFrame& noisy,
                  bool of_one_size) {
  if (!of_one_size)
    throw InputError(pair.noisy.string(), "has another size than its reference",
                     "make the pairs again");
  if (reference.layout_known && !(reference.layout == noisy.layout))
    throw InputError(pair.reference.string(),
                     fmt::format("has the layout {}, its short frame {}", reference.layout.name(),
                                 noisy.layout.name()),
                     "make the pairs again");
}

// Where its frames are, and whether they belong together.
void check_frames(const RecordedPair& pair, const NoiseModel* model) {
  FrameInfo noisy = probe_frame(pair.noisy);
  const FrameInfo reference = probe_frame(pair.reference);
  require_raw(pair.noisy.string(), noisy.holds, "name the short frame as the camera wrote it");
  if (model && noisy.frame.layout_known && !(noisy.frame.layout == model->layout))
    throw InputError(pair.noisy.string(),
                     fmt::format("has the layout {}, the noise model {}", noisy.frame.layout.name(),
                                 model->layout.name()),
                     "give the model of this camera");
  if (model) take_layout_of_model(noisy.frame, model->layout);
  require_pair(pair, reference.frame, noisy.frame,
               reference.rows == noisy.rows && reference.cols == noisy.cols);
}

Image noise_dn(const LoadedCapture& capture) {
  Image noise = above_black(capture.noisy);
  for (std::size_t i = 0; i < noise.size(); ++i) noise.values()[i] -= capture.clean_dn.values()[i];
  return noise;
}

}  // namespace

std::vector<RecordedPair> open_pairs(const std::vector<fs::path>& lists, const NoiseModel* model,
                                     const std::vector<GainSetting>& gains) {
  std::vector<RecordedPair> all;
  // None of these commands extrapolates a model, as what the model advises may do.
  std::optional<KnownGains> known;
  if (model) known.emplace(*model);
  for (const fs::path& list : lists) {
    std::vector<RecordedPair> pairs = load_pair_list(list);
    if (pairs.empty())
      throw InputError(list.string(), "holds no pairs", "make some with malus pairs");
    for (RecordedPair& pair : pairs) {
      if (!gains.empty() && std::ranges::find(gains, pair.gain) == gains.end()) continue;
      check_frames(pair, model);
      for (const GainSetting& gain : {pair.gain, pair.bias_at.value_or(pair.gain)})
        if (known) known->require(gain, fmt::format("{}: {}", list.string(), pair.name));
      all.push_back(std::move(pair));
    }
  }
  return all;
}

std::vector<RecordedPair> captures_at(const std::vector<RecordedPair>& captures,
                                      const GainSetting& gain, const fs::path& list) {
  std::vector<RecordedPair> found;
  for (const RecordedPair& capture : captures)
    if (capture.gain == gain) found.push_back(capture);
  if (found.empty())
    throw InputError(list.string(), fmt::format("has no pairs at {}", gain.text()),
                     "capture some, or set the experiment's gains");
  return found;
}

std::vector<RecordedPair> take_pictures(const NoiseModel& camera,
                                        const std::vector<fs::path>& pictures,
                                        const CameraShot& shot, const fs::path& folder,
                                        std::uint64_t seed, Progress& progress) {
  fs::create_directories(folder);
  SynthesisSettings settings;
  settings.parameters = "mean";
  settings.ratio = shot.ratio;
  const Synthesizer sensor(camera, settings);
  SaveOptions save;
  save.force = true;
  save.type = SampleType::kUint16;
  std::vector<RecordedPair> captures;
  for (const fs::path& path : pictures) {
    check_stop(progress);
    const Planes light = clean_light(path, camera, shot);
    const Image clean = mosaic_of(unpolarized(light), camera.layout);
    // Pictures of other folders may have the same name.
    const std::string name =
        fmt::format("{}_{}_{:g}", captures.size(), path.stem().string(), shot.ratio);
    RecordedPair capture{.name = name + "_00",
                         .noisy = folder / (name + "_short.tif"),
                         .reference = folder / (name + "_reference.npy"),
                         .picture = folder / (name + "_picture.npy"),
                         .ratio = shot.ratio,
                         .gain = shot.gain};
    const DrawAddress address{.seed = seed, .frame = static_cast<std::uint32_t>(captures.size())};
    RawFrame noisy = sensor.draw_raw(clean, shot.gain, address, camera.black_dn, camera.white_dn);
    noisy.gain = shot.gain;
    save_frame(capture.noisy, noisy, save);
    Planes mosaic(1, 0, 0);
    mosaic[0] = clean;
    save_floats(capture.reference, mosaic, {});
    save_floats(capture.picture, light, {});
    captures.push_back(std::move(capture));
  }
  return captures;
}

RawFrame load_short(const RecordedPair& capture, const NoiseModel* model) {
  FrameOptions options;
  if (model) options = options_for_model(options, *model, capture.noisy);
  RawFrame frame = load_frame(capture.noisy,
                              options_for_file(capture.noisy, options, FloatBlack::kAboveAlready));
  require_gain(frame, capture.gain, "its list of pairs");
  frame.gain = capture.gain;
  return frame;
}

RawFrame load_reference(const RecordedPair& capture, const RawFrame& noisy) {
  RawFrame reference = load_frame(capture.reference);
  require_pair(capture, reference, noisy,
               reference.dn.rows() == noisy.dn.rows() && reference.dn.cols() == noisy.dn.cols());
  reference.layout = noisy.layout;
  return reference;
}

LoadedCapture load_capture(const RecordedPair& capture, const NoiseModel& model,
                           ReferenceLight light) {
  LoadedCapture loaded{load_short(capture, &model), {}};
  RawFrame reference = load_reference(capture, loaded.noisy);
  if (light == ReferenceLight::kKnown)
    mark_unknown(reference.dn, white_of_reference(reference, loaded.noisy, model),
                 model.profile_at(capture.gain).defects);
  loaded.clean_dn =
      light_of_reference(std::move(reference.dn), capture.ratio, &model, capture.bias_at);
  return loaded;
}

Planes reference_colors(const RecordedPair& capture, const LoadedCapture& loaded,
                        const NoiseModel& model) {
  if (capture.picture.empty()) return demosaick_bayer(loaded.clean_dn, model.layout);
  Planes colors = load_colors(capture);
  if (colors.rows() != loaded.clean_dn.rows() || colors.cols() != loaded.clean_dn.cols())
    throw InputError(capture.picture.string(), "has another size than its reference",
                     "give the reference's light, pixel by pixel");
  for (Image& plane : colors)
    for (float& v : plane.values()) v /= static_cast<float>(capture.ratio);
  return colors;
}

NoiseDivergence divergence(const std::vector<RecordedPair>& made,
                           const std::vector<RecordedPair>& captured, const NoiseModel& model) {
  std::vector<std::pair<const RecordedPair*, const RecordedPair*>> scenes;
  for (const RecordedPair& target : captured)
    if (const RecordedPair* pair = counterpart(made, target)) scenes.emplace_back(&target, pair);
  const auto noise_of = [&](int k) {
    const auto [target, pair] = scenes[as_index(k)];
    return NoiseOfScene{noise_dn(load_capture(*target, model, ReferenceLight::kKnown)),
                        noise_dn(load_capture(*pair, model, ReferenceLight::kKnown))};
  };
  const int count = static_cast<int>(std::ssize(scenes));
  const auto d = compare_scenes(count, noise_of, NoiseComparisonSettings().bins);
  if (!d) return {};
  return {d->jsd_bits, d->sqrt_jsd_floor * d->sqrt_jsd_floor, d->sqrt_jsd, d->sqrt_jsd_floor,
          count};
}

void add_to_score(PictureScore& score, const RecordedPair& capture, const NoiseModel& model,
                  const FrameDenoiser* denoiser) {
  LoadedCapture loaded = load_capture(capture, model);
  const NoiseProfile profile = denoising_profile(loaded.noisy, model, capture.gain);
  Planes reference = reference_colors(capture, loaded, model);
  double peak = white_above_black(model.white_dn, model.black_dn) / capture.ratio;
  Planes test;
  const Stopwatch stopwatch;
  if (!denoiser) {
    test = demosaick_bayer(above_black(loaded.noisy), model.layout);
  } else if (denoiser->target() == NetworkTarget::kMosaic) {
    test = demosaick_bayer(
        (*denoiser)(std::move(loaded.noisy), profile, silent_progress()).dn_above_black,
        model.layout);
  } else {
    auto rendered = denoiser->render(std::move(loaded.noisy), profile, silent_progress());
    test = std::move(rendered.picture);
    if (denoiser->target() == NetworkTarget::kSrgb) {
      for (Image& plane : reference)
        for (float& v : plane.values())
          v = srgb_of_linear(static_cast<double>(v) / rendered.scale_dn) / 255.0f;
      peak = 1;
    }
  }
  score.seconds += stopwatch.seconds();
  const Evaluation e = evaluate_planes(reference, test, peak);
  score.psnr_db += e.image_psnr_db.value_or(0);
  score.ssim += e.image_ssim.value_or(0);
  ++score.count;
}

}  // namespace malus::app
