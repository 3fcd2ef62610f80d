#include "malus/neural/internal/plane_tensors.h"

#include "malus/base/error.h"

#include <algorithm>

namespace malus {

torch::Tensor tensor_of_planes(const Planes& planes) {
  torch::Tensor tensor = torch::empty({1, planes.channels(), planes.rows(), planes.cols()});
  float* to = tensor.data_ptr<float>();
  for (const Image& plane : planes)
    to = std::copy(plane.values().begin(), plane.values().end(), to);
  return tensor;
}

Planes planes_of_tensor(const torch::Tensor& values) {
  MALUS_REQUIRE(values.dim() == 4 && values.size(0) == 1);
  const torch::Tensor here = values.to(torch::kCPU, torch::kFloat32).contiguous();
  Planes planes(static_cast<int>(here.size(1)), static_cast<int>(here.size(2)),
                static_cast<int>(here.size(3)));
  const float* from = here.data_ptr<float>();
  for (Image& plane : planes) {
    std::copy_n(from, plane.size(), plane.values().begin());
    from += plane.size();
  }
  return planes;
}

}  // namespace malus
