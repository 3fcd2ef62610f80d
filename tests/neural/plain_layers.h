// What the kernels of inference are compared with: libtorch's layers, with weights that hide
// nothing.
#pragma once

#include "malus/neural/network.h"

#include <memory>

namespace malus::testing {

/// Weights away from their first values: nothing is zero that could hide a term.
inline std::shared_ptr<Network> scattered(const NetworkDescription& description) {
  torch::manual_seed(5);
  auto network = make_network(description);
  const torch::NoGradGuard no_gradients;
  for (torch::Tensor& parameter : network->parameters())
    parameter.add_(0.05 * torch::randn_like(parameter));
  return network;
}

/// Without the kernels, which keep no gradients.
inline torch::Tensor by_layers(Network& network, const torch::Tensor& x) {
  const torch::AutoGradMode gradients(true);
  return network.forward(x).detach();
}

inline double farthest_apart(const torch::Tensor& a, const torch::Tensor& b) {
  return (a - b).abs().max().item<double>();
}

}  // namespace malus::testing
