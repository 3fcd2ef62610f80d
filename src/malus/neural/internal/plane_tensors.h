// The packed planes of a mosaic, or of a picture, as a network's tensor and back.
#pragma once

#include "malus/image/view.h"

#include <torch/torch.h>

namespace malus {

/// [1, channel, row, col], float32 on the CPU.
torch::Tensor tensor_of_planes(const Planes& planes);

/// values: [1, channel, row, col] of any type and device; contract: that shape.
Planes planes_of_tensor(const torch::Tensor& values);

}  // namespace malus
