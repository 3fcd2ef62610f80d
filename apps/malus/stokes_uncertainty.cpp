#include "stokes_uncertainty.h"

#include "malus/base/error.h"
#include "malus/image/pack.h"
#include "malus/io/picture_file.h"
#include "malus/noise/same_sensor.h"
#include "malus/polar/uncertainty.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus::app {

Planes variance_by_model(const RawFrame& frame, const NoiseModel& model, GainRange range) {
  require_layout_of_model(frame, model.layout);
  const NoiseProfile profile = model.profile_at(frame.gain, range);
  Planes variance = pack(frame.dn, frame.layout);
  for (int k = 0; k < variance.channels(); ++k) {
    const ChannelProfile& channel = profile.channels[static_cast<std::size_t>(k)];
    const double row = channel.sigma_row_dn * channel.sigma_row_dn;
    for (float& v : variance[k].values())
      v = static_cast<float>(channel.variance(std::max(double{v}, 0.0)) + row);
  }
  return variance;
}

Planes load_variance(const std::filesystem::path& path, const RawFrame& frame) {
  Picture picture = load_picture(path);
  if (picture.holds != kHoldsVariance)
    throw InputError(path.string(), "is no file of variances",
                     "give the _variance.exr that malus denoise --uncertainty wrote for the frame");
  const std::vector<std::string> names = frame.layout.channel_names();
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
  return ordered;
}

std::array<Planes, 3> confidence_of(const StokesPicture& picture, const Planes& packed_variance,
                                    const SensorLayout& layout, Intensities intensities) {
  const auto uncertainty = uncertainty_of(picture, packed_variance, layout, intensities);
  const auto channels = static_cast<int>(uncertainty.size());
  std::array<Planes, 3> data = {Planes(channels, 0, 0), Planes(channels, 0, 0),
                                Planes(channels, 0, 0)};
  for (int k = 0; k < channels; ++k) {
    const StokesUncertainty& u = uncertainty[static_cast<std::size_t>(k)];
    data[0][k] = u.dolp_sd;
    data[1][k] = u.aolp_sd_deg;
    data[2][k] = u.dolp_corrected;
  }
  return data;
}

std::array<Planes, 3> confidence_pictures(const std::array<Planes, 3>& data,
                                          const RenderSettings& settings) {
  const std::array<double, 3> highest = {settings.dolp_max, std::sqrt(kUnknownAngleVarianceDeg2),
                                         settings.dolp_max};
  std::array<Planes, 3> pictures;
  for (std::size_t p = 0; p < data.size(); ++p) {
    Image mean = data[p][0];
    for (int k = 1; k < data[p].channels(); ++k)
      for (std::size_t i = 0; i < mean.size(); ++i) mean.values()[i] += data[p][k].values()[i];
    for (float& v : mean.values()) v /= static_cast<float>(data[p].channels());
    pictures[p] = render_rising(mean, highest[p], settings.legend);
  }
  return pictures;
}

}  // namespace malus::app
