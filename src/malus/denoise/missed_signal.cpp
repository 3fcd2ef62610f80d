#include "malus/denoise/internal/missed_signal.h"

#include "malus/base/parallel.h"

#include <algorithm>
#include <array>

namespace malus::internal {
namespace {

// Means of 5x5 pixels, the nearer ones counting more.
constexpr int kRadius = 2;
constexpr std::array<float, 2 * kRadius + 1> kTaps{1 / 16.0f, 4 / 16.0f, 6 / 16.0f, 4 / 16.0f,
                                                   1 / 16.0f};
constexpr float kNoiseOfMean = 70.0f * 70.0f / 65536.0f;  // sum of the squared weights
// Noise alone comes to three deviations too often where next to nothing is stated. What a mean
// shows of something as thin as a scratch is less than what is missing there (docs/uncertainty.md,
// "Faint marks").
constexpr float kLeastShown = 12 * kNoiseOfMean;
constexpr float kMissingOfShown = 3.0f;

float shown(float mean) { return std::max(mean * mean - kLeastShown, 0.0f); }

}  // namespace

void add_missed_signal(const FrameSource& frame, const std::vector<float>& uncut,
                       const Image& estimate, Image& error) {
  const int rows = frame.rows, cols = frame.cols;
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    const int first = static_cast<int>(begin) - kRadius,
              last = static_cast<int>(end) + kRadius;  // rows; those beyond the frame stay 0
    Image across(last - first, cols);
    std::vector<float> residual(static_cast<std::size_t>(cols + 2 * kRadius));
    for (int r = std::max(first, 0); r < std::min(last, rows); ++r) {
      for (int c = 0; c < cols; ++c) {
        const auto channel = static_cast<std::size_t>(frame.layout.channel_at(r, c));
        const float value = estimate(r, c);
        residual[static_cast<std::size_t>(c + kRadius)] =
            value > uncut[channel] ? 0.0f : frame.pixel(r, c) - value;
      }
      for (int c = 0; c < cols; ++c)
        for (std::size_t t = 0; t < kTaps.size(); ++t)
          across(r - first, c) += kTaps[t] * residual[static_cast<std::size_t>(c) + t];
    }
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < cols; ++c) {
        float mean = 0;
        for (int t = -kRadius; t <= kRadius; ++t)
          mean += kTaps[static_cast<std::size_t>(t + kRadius)] * across(r + t - first, c);
        error(r, c) += kMissingOfShown * shown(mean);
      }
  });
}

}  // namespace malus::internal
