#include "malus/neural/internal/worker_sharing.h"

namespace malus {

bool take_leaders_state(Workers& workers, TrainingState& state, bool at_end,
                        const torch::Device& device) {
  if (workers.size() == 1) return at_end;
  torch::Tensor reached =
      torch::tensor({static_cast<double>(state.step), state.first_loss, at_end ? 1.0 : 0.0,
                     state.refresh.per_step, static_cast<double>(state.refresh.from),
                     static_cast<double>(state.refresh.generation)},
                    torch::dtype(torch::kFloat64).device(device));
  workers.broadcast(reached);
  state.step = static_cast<std::int64_t>(reached[0].item<double>());
  state.first_loss = reached[1].item<double>();
  state.refresh = {reached[3].item<double>(), reached[4].item<std::int64_t>(),
                   reached[5].item<std::int64_t>()};
  for (const auto& list : {state.network.parameters(), state.average, state.adam.first_moments(),
                           state.adam.second_moments()})
    for (const torch::Tensor& values : list) {
      torch::Tensor shared = values.detach();
      workers.broadcast(shared);
    }
  return reached[2].item<double>() > 0;
}

torch::Tensor mean_over_workers(Workers& workers, const std::vector<torch::Tensor>& parameters,
                                const torch::Tensor& told) {
  if (workers.size() == 1) return told;
  std::vector<torch::Tensor> parts;
  for (const torch::Tensor& parameter : parameters)
    parts.push_back(parameter.grad().defined() ? parameter.grad().flatten()
                                               : torch::zeros_like(parameter).flatten());
  parts.push_back(told);
  torch::Tensor all = torch::cat(parts);
  workers.sum(all);
  all.div_(workers.size());
  std::int64_t at = 0;
  for (const torch::Tensor& parameter : parameters) {
    if (parameter.grad().defined())
      parameter.grad().copy_(all.slice(0, at, at + parameter.numel()).view_as(parameter));
    at += parameter.numel();
  }
  return all.slice(0, at, at + told.numel());
}

}  // namespace malus
