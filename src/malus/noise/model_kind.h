// The kinds of noise model that a session of frames is calibrated to, by name.
#pragma once

#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

enum class ModelKind { kPhysics, kGaussian, kNonparametric, kDarkFrames };
/// Their names, in that order.
inline constexpr std::array<std::string_view, 4> kModelKindNames = {"physics", "gaussian",
                                                                    "nonparametric", "dark-frames"};

constexpr std::string_view model_kind_name(ModelKind kind) {
  return kModelKindNames[static_cast<std::size_t>(kind)];
}
/// Of all kinds, or of these.
std::vector<std::string> model_kind_names();
std::vector<std::string> model_kind_names(const std::vector<ModelKind>& kinds);

/// Each throws InputError on another name.
ModelKind model_kind(std::string_view name);
std::vector<ModelKind> model_kinds(const std::vector<std::string>& names);

/// Whether there is none of it without bias frames; the others may rest on flats and bursts alone.
constexpr bool needs_bias_frames(ModelKind kind) {
  return kind == ModelKind::kPhysics || kind == ModelKind::kDarkFrames;
}

}  // namespace malus
