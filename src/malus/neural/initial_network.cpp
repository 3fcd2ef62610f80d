#include "malus/neural/internal/initial_network.h"

#include "malus/base/error.h"
#include "malus/neural/internal/same_run.h"

#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

// libtorch's own start makes the U-Net's signals fade from layer to layer, for there is no norm
// that lifts them again: He et al., ICCV 2015, Eq. 14, for LeakyReLU 0.2; transposed convolutions
// have no activation behind them and one tap per input.
void begin_unet(Network& network) {
  const torch::NoGradGuard no_gradients;
  for (auto& item : network.named_parameters()) {
    torch::Tensor& value = item.value();
    if (value.dim() == 1)
      value.zero_();
    else if (item.key().starts_with("upv"))
      value.normal_(0, 1 / std::sqrt(static_cast<double>(value.size(0))));
    else
      torch::nn::init::kaiming_normal_(value, 0.2);
  }
}

// The last convolution is set to zero, so that a residual network begins by returning its base.
void begin_with_base(Network& network, const NetworkDescription& description) {
  const torch::NoGradGuard no_gradients;
  const std::string unets =
      fmt::format("conv{}_1", 2 * description.settings.value("levels", std::int64_t{5}));
  for (auto& item : network.named_parameters())
    for (const std::string& last :
         {unets, std::string("ending"), std::string("output"), std::string("output_proj.proj.0")})
      if (item.key() == last + ".weight" || item.key() == last + ".bias") item.value().zero_();
}

// That of another run, which takes and gives the same.
std::shared_ptr<Network> network_of_another_run(const TrainingConfig& config) {
  const LoadedPackage from = load_package(config.begin_with);
  if (const Difference other =
          first_difference(package_json(config.package), package_json(from.package));
      !other.what.empty())
    throw InputError(config.begin_with.string(),
                     fmt::format("is of {} than {} asks for{}", other.what, config.source.string(),
                                 other.values("not")),
                     "make [network] and [package] those of the weights");
  from.network->train();
  return from.network;
}

}  // namespace

std::shared_ptr<Network> initial_network(const TrainingConfig& config, std::uint64_t seed) {
  torch::manual_seed(seed);
  if (!config.begin_with.empty()) return network_of_another_run(config);
  auto network = make_network(config.package.network);
  if (config.package.network.architecture == "unet") begin_unet(*network);
  if (config.package.settings.residual) begin_with_base(*network, config.package.network);
  return network;
}

}  // namespace malus
