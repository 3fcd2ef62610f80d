#include "malus/neural/same_run.h"

#include "malus/base/error.h"

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;

std::string first_difference_below(const Json& now, const Json& then, const std::string& at) {
  if (now == then) return "";
  if (!now.is_object() || !then.is_object()) return at;
  for (const auto& [key, value] : now.items())
    if (const std::string found = first_difference_below(value, then.value(key, Json()),
                                                         at.empty() ? key : at + "." + key);
        !found.empty())
      return found;
  return at;
}

// Worker 0's text on all of them.
std::string text_of_leader(Workers& workers, std::string text, const torch::Device& device) {
  const auto options = torch::dtype(torch::kInt64);
  torch::Tensor size = torch::tensor({static_cast<std::int64_t>(text.size())}, options).to(device);
  workers.broadcast(size);
  text.resize(static_cast<std::size_t>(size.item<std::int64_t>()));
  torch::Tensor bytes =
      torch::from_blob(text.data(), {size.item<std::int64_t>()}, torch::kUInt8).to(device);
  workers.broadcast(bytes);
  bytes = bytes.cpu();
  return {reinterpret_cast<const char*>(bytes.data_ptr<std::uint8_t>()), text.size()};
}

}  // namespace

std::string first_difference(const Json& now, const Json& then) {
  return first_difference_below(now, then, "");
}

void require_same_run(Workers& workers, const Json& description, const torch::Device& device) {
  if (workers.size() == 1) return;
  const Json leaders = Json::parse(text_of_leader(workers, description.dump(), device));
  const bool differs = description != leaders;
  torch::Tensor others = torch::full({1}, differs ? 1.0F : 0.0F).to(device);
  workers.sum(others);
  if (others.item<float>() == 0) return;
  const std::string who = fmt::format("worker {} of {}", workers.rank(), workers.size());
  constexpr const char* kAdvice = "start all with the same configuration, --set and --seed";
  if (!differs) throw InputError(who, "another worker has another configuration", kAdvice);
  const std::string setting = first_difference(description, leaders);
  throw InputError(
      who, fmt::format("has another {} than worker 0", setting.empty() ? "configuration" : setting),
      kAdvice);
}

}  // namespace malus
