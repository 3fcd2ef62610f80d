#include "stokes_uncertainty.h"

#include "malus/base/error.h"
#include "malus/image/pack.h"
#include "malus/io/picture_file.h"
#include "malus/noise/raw_variance.h"
#include "malus/noise/same_sensor.h"
#include "malus/polar/uncertainty.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "frame_contents.h"
#include "frame_input.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {

namespace {

constexpr std::size_t kStokesDeviations = 3;  // the first of the products

Image deviation_of(Image variance) {
  for (float& v : variance.values()) v = std::sqrt(v);
  return variance;
}

}  // namespace

PixelErrors take_out_bias(FrameAsLight& light, const NoiseModel& model, GainRange range,
                          bool fixed_pattern) {
  RawFrame& above_black = light.frame;
  require_layout_of_model(above_black, model.layout);
  const NoiseProfile profile = profile_for(above_black, model, range, fixed_pattern);
  return {pack(malus::take_out_bias(above_black, profile, light.saturated_dn), above_black.layout),
          shared_offsets(profile)};
}

Planes load_variance(const std::filesystem::path& path, const RawFrame& frame) {
  Picture picture = load_picture(path);
  if (picture.holds != kHoldsVariance)
    throw InputError(path.string(), "is no file of variances",
                     "give the _variance.exr that malus denoise --uncertainty wrote for the frame");
  const std::vector<std::string> names = plane_names(frame.layout);
  const int rows = packed_size(frame.dn.rows(), frame.layout.rows());
  const int cols = packed_size(frame.dn.cols(), frame.layout.cols());
  Planes ordered(frame.layout.channels(), 0, 0);
  for (int k = 0; k < ordered.channels(); ++k) {
    const auto name = names[static_cast<std::size_t>(k)];
    const auto found = std::find(picture.names.begin(), picture.names.end(), name);
    if (found == picture.names.end() || picture.planes.rows() != rows ||
        picture.planes.cols() != cols)
      throw InputError(
          path.string(),
          fmt::format("{} x {} planes without a channel {} of {} x {}", picture.planes.cols(),
                      picture.planes.rows(), name, cols, rows),
          "give the _variance.exr that malus denoise --uncertainty wrote for the frame");
    ordered[k] = picture.planes[static_cast<int>(found - picture.names.begin())];
  }
  require_variances(ordered, frame.layout, path.string());
  return ordered;
}

void check_noise_source(const std::filesystem::path& input, const FrameOptions& options,
                        bool by_model) {
  const FrameInfo info = probe_frame(input, headerless_part(options));
  if (by_model)
    require_raw(input.string(), info.holds,
                "give --variance with what denoise --uncertainty wrote, or the raw frame");
  else if (info.holds != kHoldsDenoised && info.frame.bits > 0)
    warn(fmt::format(
        "{}: is not marked as denoised; --variance is for denoised frames, --model for raw ones",
        input.string()));
}

Confidence confidence_of(const std::vector<StokesUncertainty>& uncertainty) {
  const auto channels = static_cast<int>(uncertainty.size());
  Confidence data;
  data.fill(Planes(channels, 0, 0));
  for (int k = 0; k < channels; ++k) {
    const StokesUncertainty& u = uncertainty[static_cast<std::size_t>(k)];
    data[0][k] = deviation_of(u.s0_variance);
    data[1][k] = deviation_of(u.s1_variance);
    data[2][k] = deviation_of(u.s2_variance);
    data[3][k] = u.dolp_sd;
    data[4][k] = u.aolp_sd_deg;
    data[5][k] = u.dolp_corrected;
  }
  return data;
}

Confidence confidence_pictures(const StokesUncertainty& mean, const RenderSettings& settings) {
  const Confidence data = confidence_of({mean});
  std::array<Image, kStokesDeviations> deviations;
  for (std::size_t p = 0; p < deviations.size(); ++p) deviations[p] = data[p][0];
  Confidence pictures;
  std::vector<Planes> stokes = render_on_one_scale(deviations, settings.legend);
  std::move(stokes.begin(), stokes.end(), pictures.begin());
  const std::array highest = {settings.dolp_max, std::sqrt(kUnknownAngleVarianceDeg2),
                              settings.dolp_max};
  for (std::size_t p = 0; p < highest.size(); ++p)
    pictures[kStokesDeviations + p] =
        render_rising(data[kStokesDeviations + p][0], highest[p], settings.legend);
  return pictures;
}

}  // namespace malus::app
