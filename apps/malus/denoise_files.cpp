#include "denoise_files.h"

#include "malus/base/error.h"
#include "malus/image/pack.h"
#include "malus/io/picture_file.h"
#include "malus/noise/raw_variance.h"

#include <algorithm>
#include <cmath>

#include "frame_input.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

// A large frame's pixels exist once: they move into the file's frame and back.
void save_mosaic(const fs::path& path, const RawFrame& header, double lowered_dn,
                 Image& dn_above_black, const SaveOptions& save) {
  RawFrame out = header;
  out.white_dn = white_above_black(header.white_dn, header.black_dn) - lowered_dn;
  std::fill(out.black_dn.begin(), out.black_dn.end(), 0.0);
  out.bits = 0;
  out.dn = std::move(dn_above_black);
  save_frame(path, out, save);
  dn_above_black = std::move(out.dn);
}

void save_integers(const fs::path& path, const RawFrame& header, double lowered_dn,
                   const Image& dn_above_black, SaveOptions save) {
  RawFrame out = header;
  out.white_dn = std::nearbyint(header.white_dn - lowered_dn);  // as its pixels
  out.dn = dn_above_black;
  for (int r = 0; r < out.dn.rows(); ++r)
    for (int c = 0; c < out.dn.cols(); ++c)
      if (float& dn = out.dn(r, c); std::isfinite(dn))
        dn += static_cast<float>(header.black_at(r, c));
      else  // as fate_of_nonfinite tells
        dn = dn > 0 ? static_cast<float>(out.white_dn) : 0.0f;
  save.type = SampleType::kUint16;
  save_frame(path, out, save);
}

}  // namespace

void check_integers(const RawFrame& frame, const NoiseProfile& profile, const std::string& remedy) {
  constexpr double kHighest = 65535;
  const double lowest_black_dn = *std::min_element(frame.black_dn.begin(), frame.black_dn.end());
  if (lowest_black_dn < 0)
    throw InputError(
        frame.source,
        fmt::format("black {:g} DN is below 0, where integers of 16 bits begin", lowest_black_dn),
        remedy);
  if (frame.white_dn > kHighest)
    throw InputError(frame.source,
                     fmt::format("white {:g} DN is above {:g}, the largest integer of 16 bits",
                                 frame.white_dn, kHighest),
                     remedy);
  if (frame.bits > 0) return;  // integers hold it already
  const double range_dn = white_above_black(frame.white_dn, frame.black_dn);
  double deviation_dn = 0;
  for (const ChannelProfile& channel : profile.channels)
    deviation_dn = std::max(deviation_dn, std::sqrt(channel.variance(range_dn)));
  const double rounding_dn = 1 / std::sqrt(12.0);
  if (deviation_dn < rounding_dn)
    throw InputError(
        frame.source,
        fmt::format("its noise, {:.2g} DN at white, is less than what rounding to integers adds",
                    deviation_dn),
        remedy);
}

void check_integers_of_camera(const NoiseModel& model, const fs::path& file,
                              const GainSetting& gain, GainRange range) {
  constexpr double kUnknownWhite_dn = 65535;
  RawFrame camera;
  camera.source = file.string();
  camera.layout = model.layout;
  camera.black_dn = model.black_dn;
  camera.white_dn = model.white_dn > 0 ? model.white_dn : kUnknownWhite_dn;
  camera.bits = model.quantization_dn > 0 ? 16 : 0;
  NoiseProfile profile;
  if (camera.bits == 0) profile = naming_model(file, [&] { return model.profile_at(gain, range); });
  check_integers(camera, profile, "give --float");
}

std::vector<std::string> write_outputs(const RawFrame& header, const NoiseProfile& profile,
                                       Denoised& result, const OutputNames& names, bool force) {
  std::vector<std::string> files;
  const double lowered_dn = highest_bias_dn(profile);
  SaveOptions save;
  save.force = force;
  save.type = SampleType::kFloat;
  SaveOptions denoised = save;
  denoised.holds = kHoldsDenoised;
  save_mosaic(names.mosaic, header, lowered_dn, result.dn_above_black, denoised);
  files.push_back(names.mosaic.string());
  const std::vector<std::string> channels = plane_names(header.layout);
  if (!names.planes.empty()) {
    save_picture(names.planes, pack(result.dn_above_black, header.layout), channels, save);
    files.push_back(names.planes.string());
  }
  if (!names.variance.empty()) {
    SaveOptions variance = save;
    variance.holds = kHoldsVariance;
    save_picture(names.variance, pack(*result.variance_dn2, header.layout), channels, variance);
    files.push_back(names.variance.string());
  }
  if (!names.integers.empty()) {
    save_integers(names.integers, header, lowered_dn, result.dn_above_black, denoised);
    files.push_back(names.integers.string());
  }
  return files;
}

void save_result_picture(const fs::path& path, Planes picture, NetworkTarget target, bool force) {
  SaveOptions save;
  save.force = force;
  const std::string ending = path.extension();
  if (target == NetworkTarget::kSrgb && (ending == ".tif" || ending == ".png")) {
    save.type = SampleType::kUint16;
    for (Image& plane : picture)
      for (float& v : plane.values()) v *= 65535.0f;
  } else {
    save.type = SampleType::kFloat;
  }
  save_picture(path, picture, {"R", "G", "B"}, save);
}

}  // namespace malus::app
