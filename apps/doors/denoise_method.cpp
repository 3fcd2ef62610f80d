#include "denoise_method.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/denoise/frame_complaints.h"

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <system_error>

#include "networks_door.h"
#include <fmt/format.h>

namespace malus::app {
bool is_weight_file(const std::string& method) { return method.ends_with(".safetensors"); }

void require_method(const std::string& name) {
  if (is_weight_file(name)) return;
  std::error_code none;
  const bool known = std::ranges::any_of(
      denoise_methods(), [&](const DenoiseMethod& method) { return method.name == name; });
  if (!known && std::filesystem::is_directory(name, none)) {
    const std::filesystem::path weights = std::filesystem::path(name) / "weights.safetensors";
    throw InputError(setting("method", name), "is a folder",
                     std::filesystem::exists(weights, none)
                         ? "give the weights in it: " + weights.string()
                         : "give a network's weight file (weights.safetensors of a training)");
  }
  denoise_method(name, ", and networks' weight files (.safetensors)");
}

std::string baseline_names() {
  std::vector<std::string> names;
  for (const DenoiseMethod& method : denoise_methods())
    if (!method.on_mosaic()) names.push_back(method.name);
  return joined(names);
}

std::vector<std::string> picture_complaints(const NetworkInference::Rendered& made) {
  const auto pixels = std::int64_t{made.picture.rows()} * made.picture.cols();
  std::vector<std::string> lines = frame_complaints(made.report, false, pixels);
  if (made.report.noise) lines.push_back(noise_complaint(*made.report.noise));
  std::erase(lines, "");
  return lines;
}

FrameDenoiser::FrameDenoiser(const DenoiseSettings& settings, const InferenceSettings& inference,
                             bool uncertainty)
    : settings_(settings), uncertainty_(uncertainty) {
  require_method(settings.method);
  if (!is_weight_file(settings.method)) return;
  network_ = networks().open_denoiser({settings.method, inference});
  if (const auto taken = network_->description().at("precision").get<std::string>();
      taken != inference.precision)
    precision_complaint_ = fmt::format("{}: on this processor it is no faster with {}; {} is taken",
                                       settings.method, inference.precision, taken);
}

FrameDenoiser::~FrameDenoiser() = default;

Denoised FrameDenoiser::operator()(RawFrame frame, const NoiseProfile& profile, Progress& progress,
                                   double held_values) const {
  DenoiseSettings settings = settings_;
  settings.held_values = held_values;
  if (network_)
    return network_->denoise(std::move(frame), profile, settings, progress, uncertainty_);
  return denoise_frame(std::move(frame), profile, settings, progress, uncertainty_);
}

NetworkTarget FrameDenoiser::target() const {
  return network_ ? network_->target() : NetworkTarget::kMosaic;
}

bool FrameDenoiser::takes_ratio() const {
  if (!network_) return false;
  const nlohmann::ordered_json package = network_->description().at("package");
  return package.at("domain") == "linear" && package.at("amplification") == "ratio";
}

bool FrameDenoiser::undoes_cut_off() const {
  if (!network_) return denoise_method(settings_.method).stabilizes;
  return network_->description().at("package").at("domain") == "stabilised";
}

void FrameDenoiser::require_used(const std::vector<std::string>& inference_settings) const {
  for (const std::string& name : inference_settings) {
    if (name == "ratio" && !takes_ratio())
      throw InputError(setting_name(name),
                       fmt::format("{} does not amplify by it", settings_.method),
                       "leave it out, or use a network trained with amplification = \"ratio\"");
    if (!network_)
      throw InputError(setting_name(name),
                       fmt::format("{} is no network and does not look at it", settings_.method),
                       "leave it out, or name a network's weight file with " + setting("method"));
  }
}

void FrameDenoiser::require_used_of_filter(const std::vector<std::string>& denoise_settings) const {
  if (network_ || denoise_method(settings_.method).on_mosaic()) return;
  for (const std::string& name : denoise_settings)
    if (name == "row_noise" || name == "column_noise" || name == "like_pixels")
      throw InputError(setting_name(name),
                       fmt::format("{} is a baseline and does not look at it", settings_.method),
                       "leave it out, or use nl-ridge or bm3d");
}

NetworkInference::Rendered FrameDenoiser::render(RawFrame frame, const NoiseProfile& profile,
                                                 Progress& progress) const {
  MALUS_REQUIRE(network_);
  return network_->render(std::move(frame), profile, settings_, progress);
}

nlohmann::ordered_json FrameDenoiser::description() const {
  return network_ ? network_->description() : nlohmann::ordered_json();
}

}  // namespace malus::app
