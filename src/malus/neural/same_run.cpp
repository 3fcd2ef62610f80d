#include "malus/neural/internal/same_run.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;

// Where a description's parts are told in the configuration. What follows from others comes after
// them: a guide makes the network's planes, names of files their contents.
struct Part {
  const char *key, *name;
};
constexpr Part kParts[] = {{"package", "package"},
                           {"network", "network"},
                           {"sensor", "sensor"},
                           {"data", "data"},
                           {"pictures", "data.pictures"},
                           {"scenes", "data.scenes"},
                           {"shards", "data.shards"},
                           {"pairs", "data.pairs"},
                           {"tone", "data.tone"},
                           {"noise", "noise"},
                           {"train", "train"},
                           {"begin_with", "train.begin_with"},
                           {"validation", "validation"},
                           {"validation_scenes", "validation.scenes"},
                           {"cases", "validation.cases"},
                           {"seed", "seed"}};
constexpr Part kContents[] = {
    {"models", "noise.models"},        {"pictures", "data.pictures"},
    {"scenes", "data.scenes"},         {"shards", "data.shards"},
    {"pairs", "data.pairs"},           {"validation_scenes", "validation.scenes"},
    {"begin_with", "train.begin_with"}};

Json value_at(const Json& object, const std::string& key) {
  return object.is_object() ? object.value(key, Json()) : Json();
}

std::string short_text(const Json& value) {
  constexpr std::size_t kMost = 40;
  std::string text = value.is_null() ? "none" : value.dump();
  return text.size() <= kMost ? text : "";
}

Difference difference_below(const Json& now, const Json& then, const std::string& name) {
  if (now == then) return {};
  Json keys = now.is_object() ? now : Json::object();
  if (then.is_object()) keys.update(then);
  for (const auto& [key, value] : keys.items()) {
    // The table of a configuration has no part called settings.
    const std::string below = key == "settings" ? name : name + "." + key;
    if (Difference found = difference_below(value_at(now, key), value_at(then, key), below);
        !found.what.empty())
      return found;
  }
  return {"another " + name, short_text(now), short_text(then)};
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

std::string Difference::values(const char* word) const {
  return now.empty() || then.empty() ? "" : fmt::format(": {}, {} {}", then, word, now);
}

Difference first_difference(const Json& now, const Json& then) {
  for (const auto& [key, name] : kParts)
    if (Difference found = difference_below(value_at(now, key), value_at(then, key), name);
        !found.what.empty())
      return found;
  const Json files = value_at(now, "contents"), others = value_at(then, "contents");
  for (const auto& [key, name] : kContents)
    if (value_at(files, key) != value_at(others, key))
      return {fmt::format("other files of {}", name), "", ""};
  return now == then ? Difference{} : Difference{"another configuration", "", ""};
}

void require_same_run(Workers& workers, const Json& description, const torch::Device& device) {
  if (workers.size() == 1) return;
  const Json leaders = Json::parse(text_of_leader(workers, description.dump(), device));
  const bool differs = description != leaders;
  torch::Tensor others = torch::full({1}, differs ? 1.0F : 0.0F).to(device);
  workers.sum(others);
  if (others.item<float>() == 0) return;
  const std::string who = fmt::format("worker {} of {}", workers.rank(), workers.size());
  const std::string advice = fmt::format("start all with the same configuration, {} and {}",
                                         setting("set"), setting("seed"));
  if (!differs) throw InputError(who, "another worker has another configuration", advice);
  throw InputError(who,
                   fmt::format("has {} than worker 0", first_difference(description, leaders).what),
                   advice);
}

}  // namespace malus
