// Training losses of 000, section 5.3: of a network's own planes. In domain "linear" these are
// light, and Eq. 9 is the paper's. In "stabilised" they are variance-stabilised: their sums and
// differences are no Stokes parameters, and bright places count less (docs/training.md).
#pragma once

#include "malus/image/layout.h"
#include "malus/neural/training_config.h"

#include <torch/torch.h>

namespace malus {

/// Eq. 8: mean |y - x| over all values. One whose target is not known, which is NaN (RawPair), adds
/// nothing but counts: workers hold equal parts of a batch, whatever is known of them, and the mean
/// over parts is that of the whole.
torch::Tensor l1_distance(const torch::Tensor& output, const torch::Tensor& target);

/// Eq. 9: over the colours of the layout, the mean L1 distance of (S0, S1, S2), where the planes
/// are light. Of a target, those are known whose angles all are. Planes are [batch, channel, row,
/// col] in the layout's channel order. Contract: layout.polarized() and as many channels.
torch::Tensor stokes_loss(const torch::Tensor& output, const torch::Tensor& target,
                          const SensorLayout& layout);

/// Loss of a batch as [train] says.
torch::Tensor training_loss(const TrainSettings& settings, const SensorLayout& layout,
                            const torch::Tensor& output, const torch::Tensor& target);

/// [batch, 3 * colours, row, col]: S0, S1, S2 of each colour of the layout.
torch::Tensor stokes_planes(const torch::Tensor& planes, const SensorLayout& layout);

}  // namespace malus
