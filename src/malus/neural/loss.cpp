#include "malus/neural/loss.h"

#include "malus/base/error.h"

namespace malus {

torch::Tensor l1_distance(const torch::Tensor& output, const torch::Tensor& target) {
  // Left out before anything is made of them: the gradient of |NaN| is NaN, whatever its weight.
  const torch::Tensor known = (output - target).masked_fill(target.isnan(), 0);
  return known.abs().sum() / target.numel();
}

torch::Tensor stokes_planes(const torch::Tensor& planes, const SensorLayout& layout) {
  MALUS_REQUIRE(layout.polarized() && planes.size(1) == layout.channels());
  std::vector<torch::Tensor> stokes;
  for (const Color color : layout.colors()) {
    const auto plane = [&](int angle) { return planes.select(1, layout.find(color, angle)); };
    const auto i0 = plane(0), i45 = plane(45), i90 = plane(90), i135 = plane(135);
    stokes.push_back(0.5 * (i0 + i45 + i90 + i135));  // as polar/stokes.h
    stokes.push_back(i0 - i90);
    stokes.push_back(i45 - i135);
  }
  return torch::stack(stokes, 1);
}

torch::Tensor stokes_loss(const torch::Tensor& output, const torch::Tensor& target,
                          const SensorLayout& layout) {
  return l1_distance(stokes_planes(output, layout), stokes_planes(target, layout));
}

torch::Tensor training_loss(const TrainSettings& settings, const SensorLayout& layout,
                            const torch::Tensor& output, const torch::Tensor& target) {
  if (settings.loss == "l1") return l1_distance(output, target);
  const torch::Tensor stokes = stokes_loss(output, target, layout);
  if (settings.loss == "stokes") return stokes;
  return l1_distance(output, target) + settings.stokes_weight * stokes;
}

}  // namespace malus
