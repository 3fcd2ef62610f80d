// A method of denoising for frames of any light.
#pragma once

#include <optional>
#include <utility>

#include "denoise_method.h"

namespace malus::app {

/// Some networks take the low-light ratio, so for them another ratio makes another denoiser; the
/// last one is kept, its weights are not read again.
class DenoiserByRatio {
 public:
  explicit DenoiserByRatio(DenoiseSettings settings, InferenceSettings inference = {},
                           bool uncertainty = false)
      : settings_(std::move(settings)),
        inference_(std::move(inference)),
        uncertainty_(uncertainty) {}
  /// Until the next call. Throws InputError as FrameDenoiser does.
  const FrameDenoiser& at(double ratio) {
    if (!last_ || (ratio != inference_.ratio && last_->takes_ratio())) {
      inference_.ratio = ratio;
      last_.emplace(settings_, inference_, uncertainty_);
    }
    return *last_;
  }

 private:
  DenoiseSettings settings_;
  InferenceSettings inference_;
  bool uncertainty_;
  std::optional<FrameDenoiser> last_;
};

}  // namespace malus::app
