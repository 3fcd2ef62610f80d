// Sets of frames with noise that is known.
#pragma once

#include "malus/base/random.h"
#include "malus/evaluate/noise_comparison.h"

#include <cmath>

namespace malus::testing {

struct Noise {
  double sd = 4, sd_row = 0, sd_column = 0, slope = 0, mean = 0;
  int row_group = 1;
  double row_decay = 0;  ///< of a first-order autoregressive series of rows
  bool rounded = false;
};

inline constexpr int kRows = 96, kCols = 128;

// A ramp from 0 to 1270 DN, or darkness.
inline Image ramp(bool dark = false) {
  Image clean(kRows, kCols);
  for (int r = 0; r < kRows; ++r)
    for (int c = 0; c < kCols; ++c) clean(r, c) = dark ? 0.0f : 10.0f * static_cast<float>(c);
  return clean;
}

inline NoiseFrames frames_of(const Image& clean, const Noise& noise, int count,
                             std::uint64_t seed) {
  return {count, [=](int k) {
            const auto frame_number = static_cast<std::uint32_t>(k);
            RandomSequence pixels(seed, frame_number, Draw::kPixel);
            RandomSequence rows(seed, frame_number, Draw::kRow);
            RandomSequence columns(seed, frame_number, Draw::kOther);
            Image frame = clean;
            std::vector<double> column(kCols);
            for (double& v : column) v = noise.sd_column * columns.normal();
            double row = 0;
            for (int r = 0; r < kRows; ++r) {
              if (r % noise.row_group == 0)
                row = noise.row_decay * row + noise.sd_row *
                                                  std::sqrt(1 - noise.row_decay * noise.row_decay) *
                                                  rows.normal();
              for (int c = 0; c < kCols; ++c) {
                const double variance = noise.sd * noise.sd + noise.slope * clean(r, c);
                double v = clean(r, c) + noise.mean + row + column[static_cast<std::size_t>(c)] +
                           std::sqrt(variance) * pixels.normal();
                if (noise.rounded) v = std::round(v);
                frame(r, c) = static_cast<float>(v);
              }
            }
            return frame;
          }};
}

}  // namespace malus::testing
