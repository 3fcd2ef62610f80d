#include "malus/neural/named_networks.h"

#include <utility>

namespace malus {
namespace {

using Json = nlohmann::json;

Json uformer(int dim, std::vector<int> depths) {
  return {{"embed_dim", dim}, {"depths", std::move(depths)}};
}

}  // namespace

std::vector<NamedNetwork> named_networks() {
  const Json empty = Json::object();
  return {{"unet", "unet", empty},
          {"nafnet-32", "nafnet", empty},
          {"uformer-t", "uformer", uformer(16, {2, 2, 2, 2, 2, 2, 2, 2, 2})},
          {"uformer-s", "uformer", uformer(32, {2, 2, 2, 2, 2, 2, 2, 2, 2})},
          {"uformer-b", "uformer", uformer(32, {1, 2, 8, 8, 2, 8, 8, 2, 1})},
          {"restormer", "restormer", empty},
          {"malus-small", "malus", empty},
          {"malus-base", "malus", {{"dim", 48}, {"depths", {2, 4, 4, 6}}}}};
}

NamedNetwork network_of_name(const std::string& name) {
  for (NamedNetwork& known : named_networks())
    if (known.name == name) return known;
  return {name, name, Json::object()};
}

}  // namespace malus
