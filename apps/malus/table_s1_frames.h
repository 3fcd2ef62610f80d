// The rows of 001 Table S1: ways to make frames of a noisier gain from those of another.
#pragma once

#include "malus/image/view.h"
#include "malus/noise/model.h"
#include "malus/synthesize/exact.h"

#include <functional>
#include <string>

namespace malus::app {

/// What makes the training frames of one row: 001 Table S1's first three columns.
struct TableS1Row {
  std::string noise;     ///< "NP", "HG"; of captures ""
  std::string scheme;    ///< "noise-on-noise", "calibrated", "captured"
  std::string denoiser;  ///< "UNet", "BM3D"; of captures ""

  std::string title() const {
    if (scheme == "captured") return "captured (upper bound)";
    return noise + (scheme == "calibrated" ? " Calibrated" : " Noise-on-noise");
  }
  std::string folder() const {
    return scheme == "captured" ? scheme : noise + "-" + scheme + "-" + denoiser;
  }
};

/// A frame of the noisier gain, DN above black, from a noisy frame and what a denoiser says of it.
using FrameMaker =
    std::function<Image(const Image& noisy_dn, const Image& guide_dn, const DrawAddress& address)>;

/// Of a row that is not captured. Throws InputError where the model lacks what the row needs at the
/// gains.
FrameMaker frame_maker(const TableS1Row& row, const NoiseModel& model, const GainSetting& from,
                       const GainSetting& to);

}  // namespace malus::app
