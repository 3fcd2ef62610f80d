#include "malus/neural/internal/gated_block.h"

#include "malus/neural/internal/tasks.h"

#include <algorithm>

namespace malus::internal {
namespace {

// Pixels of a task of the second half, of few channels and of many, whose weights come from farther
// away, in whole tiles of products: 6 rows, or 12. Fewer where threads would go without.
constexpr std::ptrdiff_t kFewPixels = 132, kMorePixels = 264, kMuch = 256, kLeastPixels = 48,
                         kTilePixels = 12;
// The attention is multiplied into the weights where they are fewer than this many pixels' values.
constexpr std::ptrdiff_t kPixelsPerChannel = 4;

}  // namespace

void GatedBlock::filter(const torch::Tensor& x) const {
  const std::ptrdiff_t batch = x.size(0), channels = x.size(3), pixels = x.size(1) * x.size(2);
  const torch::Tensor gated = torch::empty_like(x), means = strip_gate(x, wide, gated),
                      factors = torch::empty({batch, channels}, torch::kFloat);
  attention.run(means.data_ptr<float>(), batch, factors.data_ptr<float>(), channels);
  for (std::ptrdiff_t image = 0; image < batch; ++image)
    second_half(x.data_ptr<float>() + image * pixels * channels,
                gated.data_ptr<float>() + image * pixels * channels,
                factors.data_ptr<float>() + image * channels, pixels);
}

// Everything after the pooled attention, a few pixels at a time.
void GatedBlock::second_half(float* x, const float* gated, const float* factors,
                             std::ptrdiff_t pixels) const {
  const std::ptrdiff_t c = project.cols(), most = c < kMuch ? kFewPixels : kMorePixels;
  const std::ptrdiff_t wanted =
      std::max((pixels + most - 1) / most, std::min(task_threads(), pixels / kLeastPixels + 1));
  const std::ptrdiff_t piece =
      ((pixels + wanted - 1) / wanted + kTilePixels - 1) / kTilePixels * kTilePixels;
  const bool in_weights = !project.rounded() && pixels >= kPixelsPerChannel * c;
  const PackedLinear scaled = in_weights ? project.with_inputs_scaled(factors) : project;
  for_each_task((pixels + piece - 1) / piece, [&](std::ptrdiff_t task) {
    const std::ptrdiff_t first = task * piece, count = std::min(piece, pixels - first);
    const std::ptrdiff_t memory = feed_forward.memory(count, 1);
    Scratch scratch(count * c + memory + 2 * kLane);
    float *narrow_values = scratch.take(count * c), *normal = scratch.take(memory),
          *out = x + first * c;
    const float* attended = gated + first * c;
    if (!in_weights) {
      scale_columns(attended, c, count, c, factors, narrow_values, c);
      attended = narrow_values;
    }
    scaled.run(attended, count, out, c, true);
    MatrixProduct p{.rows = count, .a = out};
    p.a_row = c;
    p.c = narrow_values;
    p.c_row = c;
    p.ahead = out + count * c;
    p.ahead_row = c;
    feed_forward.run(p, normal);
    narrow.run(narrow_values, count, out, c, true, gated + (first + count) * c);
  });
}

}  // namespace malus::internal
