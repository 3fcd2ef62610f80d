#include "malus/neural/internal/checkpoint.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"
#include "malus/neural/internal/same_run.h"

#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;

constexpr const char* kBuffers = "buffers/";

std::string start_again() {
  return fmt::format("train anew: without {}, with {}", setting("resume", true),
                     setting("force", true));
}

// Every tensor of the state under its name in the file.
template <class Visit>
void for_each_tensor(TrainingState& state, Visit&& visit) {
  std::size_t i = 0;
  for (auto& item : state.network.named_parameters()) {
    visit("weights/" + item.key(), item.value());
    visit("average/" + item.key(), state.average[i]);
    visit("first_moment/" + item.key(), state.adam.first_moments()[i]);
    visit("second_moment/" + item.key(), state.adam.second_moments()[i]);
    ++i;
  }
  for (auto& item : state.network.named_buffers()) visit(kBuffers + item.key(), item.value());
}

// What changes nothing in a step, nor what a validation sees. The cosine's rate follows from the
// number of steps.
void remove_free_settings(Json& description) {
  if (description.contains("data")) description["data"].erase("memory");
  if (description.contains("validation")) description["validation"].erase("every");
  if (!description.contains("train")) return;
  Json& train = description["train"];
  for (const char* key : {"log_every", "checkpoint_every", "timeout", "recorded"}) train.erase(key);
  if (train.value("schedule", "cosine") != "cosine") train.erase("steps");
}

void require_same_settings(Json now, Json then, const std::string& source) {
  remove_free_settings(now);
  remove_free_settings(then);
  if (now == then) return;
  const Difference other = first_difference(now, then);
  throw InputError(source, fmt::format("belongs to a run with {}{}", other.what, other.values()),
                   "set it as it was, or train in another folder");
}

}  // namespace

void save_checkpoint(const TrainingState& state, const Json& description,
                     const std::filesystem::path& path) {
  TrainingState copy = state;
  TensorFile file;
  for_each_tensor(copy, [&](const std::string& name, const torch::Tensor& tensor) {
    file.tensors[name] = from_torch(tensor.detach().cpu());
  });
  file.metadata[kCheckpointKey] = Json{
      {"step", state.step},
      {"best_score_db", state.best_score_db},
      {"seconds", state.seconds},
      {"first_loss", state.first_loss},
      {"brightest", std::isfinite(state.brightest) ? state.brightest : 0},
      {"refresh", {state.refresh.per_step, state.refresh.from, state.refresh.generation}},
      {"description", description}}.dump();
  save_tensor_file(file, path);
}

void load_checkpoint(TrainingState& state, const Json& description,
                     const std::filesystem::path& path) {
  const torch::NoGradGuard no_gradients;
  const TensorFile file = load_tensor_file(path);
  const auto found = file.metadata.find(kCheckpointKey);
  if (found == file.metadata.end())
    throw InputError(path.string(), "is not a checkpoint", start_again());
  try {
    const Json facts = Json::parse(found->second);
    Json stored = facts.at("description");
    // Of the time when all networks gave mosaics.
    if (stored.contains("package") && !stored["package"].contains("target"))
      stored["package"]["target"] = "mosaic";
    // Of the time when files were known by their names alone.
    if (!stored.contains("contents") && description.contains("contents"))
      stored["contents"] = description["contents"];
    require_same_settings(description, stored, path.string());
    state.step = facts.at("step").get<std::int64_t>();
    state.best_score_db = facts.at("best_score_db").get<double>();
    state.seconds = facts.at("seconds").get<double>();
    state.first_loss = facts.value("first_loss", 0.0);
    state.brightest = facts.value("brightest", 0.0);  // 0: infinite, or of an older checkpoint
    const Json refresh = facts.value("refresh", Json::array({0.0, 0, 0}));  // since 2026-11-26
    state.refresh = {refresh.at(0), refresh.at(1), refresh.at(2)};
  } catch (const Json::exception& error) {
    throw InputError(path.string(), fmt::format("cannot be read ({})", error.what()),
                     start_again());
  }
  const Json train = description.value("train", Json::object());
  if (const auto steps = train.value("steps", state.step); state.step > steps)
    throw InputError(path.string(),
                     fmt::format("is at step {}, beyond the last, {}", state.step, steps),
                     "set train.steps to as many or more");
  for_each_tensor(state, [&](const std::string& name, torch::Tensor& tensor) {
    const auto stored = file.tensors.find(name);
    if (stored == file.tensors.end() || torch::IntArrayRef(stored->second.shape) != tensor.sizes())
      throw InputError(path.string(), fmt::format("lacks \"{}\" or its size differs", name),
                       start_again());
    if (!name.starts_with(kBuffers))
      tensor.copy_(to_torch(stored->second));
    else if (!is_as_built(tensor, stored->second))
      throw InputError(path.string(),
                       fmt::format("\"{}\" is not what the network's settings make it", name),
                       start_again());
  });
}

}  // namespace malus
