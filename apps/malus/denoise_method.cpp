#include "denoise_method.h"

#include "malus/base/error.h"

#include <algorithm>
#include <filesystem>
#include <system_error>

#include "networks_door.h"
#include "program.h"
#include <CLI/CLI.hpp>
#include <fmt/format.h>

namespace malus::app {
namespace {

bool is_weight_file(const std::string& method) { return method.ends_with(".safetensors"); }

}  // namespace

void require_method(const std::string& name) {
  if (is_weight_file(name)) return;
  std::error_code none;
  const bool known = std::ranges::any_of(
      denoise_methods(), [&](const DenoiseMethod& method) { return method.name == name; });
  if (!known && std::filesystem::is_directory(name, none)) {
    const std::filesystem::path weights = std::filesystem::path(name) / "weights.safetensors";
    throw InputError("--method " + name, "is a folder",
                     std::filesystem::exists(weights, none)
                         ? "give the weights in it: " + weights.string()
                         : "give a network's weight file (weights.safetensors of a training)");
  }
  denoise_method(name, ", and networks' weight files (.safetensors)");
}

FrameDenoiser::FrameDenoiser(const DenoiseSettings& settings, const InferenceSettings& inference,
                             bool uncertainty)
    : settings_(settings), uncertainty_(uncertainty) {
  require_method(settings.method);
  const bool network = is_weight_file(settings.method);
  // No file could make these two go together: wrong usage.
  if (uncertainty && !network && !denoise_method(settings.method).on_mosaic)
    throw CLI::ValidationError(
        "--uncertainty",
        fmt::format("{} gives none: leave it out, or use nl-ridge or bm3d", settings.method));
  if (!network) return;
  network_ = networks().open_denoiser({settings.method, inference});
  if (const auto taken = network_->description().at("precision").get<std::string>();
      taken != inference.precision)
    warn(fmt::format("{}: on this processor it is no faster with {}; {} is taken", settings.method,
                     inference.precision, taken));
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

std::string FrameDenoiser::target() const { return network_ ? network_->target() : "mosaic"; }

bool FrameDenoiser::takes_ratio() const {
  if (!network_) return false;
  const nlohmann::ordered_json package = network_->description().at("package");
  return package.at("domain") == "linear" && package.at("amplification") == "ratio";
}

bool FrameDenoiser::undoes_cut_off() const {
  return !network_ || network_->description().at("package").at("domain") == "stabilised";
}

void FrameDenoiser::require_used(const std::vector<std::string>& inference_flags) const {
  for (const std::string& flag : inference_flags) {
    if (flag == "--ratio" && !takes_ratio())
      throw InputError(flag, fmt::format("{} does not amplify by it", settings_.method),
                       "leave it out, or use a network trained with amplification = \"ratio\"");
    if (!network_)
      throw InputError(flag,
                       fmt::format("{} is no network and does not look at it", settings_.method),
                       "leave it out, or name a network's weight file with --method");
  }
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
