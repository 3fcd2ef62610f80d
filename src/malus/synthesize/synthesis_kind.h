// What noise is drawn from, by name.
#pragma once

#include "malus/noise/model_kind.h"

#include <array>
#include <string>
#include <string_view>

namespace malus {

enum class SynthesisKind { kPhysics, kPoissonGaussian, kGaussian, kNonparametric, kDarkFrames };
/// Their names, in that order.
inline constexpr std::array<std::string_view, 5> kSynthesisKindNames = {
    "physics", "poisson-gaussian", "gaussian", "nonparametric", "dark-frames"};

/// The kind of model that tells this noise.
constexpr ModelKind drawn_from(SynthesisKind kind) {
  switch (kind) {
    case SynthesisKind::kGaussian:
      return ModelKind::kGaussian;
    case SynthesisKind::kNonparametric:
      return ModelKind::kNonparametric;
    case SynthesisKind::kDarkFrames:
      return ModelKind::kDarkFrames;
    case SynthesisKind::kPhysics:
    case SynthesisKind::kPoissonGaussian:
      break;
  }
  return ModelKind::kPhysics;
}

inline std::string synthesis_kind_name(SynthesisKind kind) {
  return std::string(kSynthesisKindNames[static_cast<std::size_t>(kind)]);
}

/// Throws InputError on another name.
SynthesisKind synthesis_kind(const std::string& name);

}  // namespace malus
