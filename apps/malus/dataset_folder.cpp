#include "dataset_folder.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/fingerprint.h"
#include "malus/base/unfinished_files.h"
#include "malus/io/shard_read.h"

#include <algorithm>
#include <cctype>
#include <cstdint>
#include <fstream>
#include <optional>
#include <sstream>
#include <system_error>
#include <vector>

#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

bool is_shard_name(std::string_view name) {
  constexpr std::string_view kBegin = "shard-", kEnd = ".tar";
  if (!name.starts_with(kBegin) || !name.ends_with(kEnd)) return false;
  name = name.substr(kBegin.size(), name.size() - kBegin.size() - kEnd.size());
  return !name.empty() && std::all_of(name.begin(), name.end(),
                                      [](unsigned char c) { return std::isdigit(c) != 0; });
}

std::vector<fs::path> shards_in(const fs::path& folder) {
  std::vector<fs::path> shards;
  for (const auto& entry : fs::directory_iterator(folder))
    if (is_shard_name(entry.path().filename().string())) shards.push_back(entry.path());
  return shards;
}

// The set that a shard's first sample names; empty where it names none or the shard is damaged.
std::string set_of_shard(const fs::path& path) {
  try {
    for (const ShardEntry& entry : shard_entries(path))
      if (entry.name.ends_with(".json"))
        return nlohmann::json::parse(shard_content(path, entry)).value(kSetKey, "");
  } catch (const InputError&) {
  } catch (const nlohmann::json::exception&) {
  }
  return {};
}

std::optional<std::string> whole_text(const fs::path& path) {
  const std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::stringstream text;
  text << file.rdbuf();
  return text.str();
}

// A worker beside this one may put its own new shard in the place of an old one at any instant. So
// the file is taken away first and looked at then; under this name a killed run's are cleared away.
void remove_shard_of_another_set(const fs::path& path, const std::string& set) {
  if (set_of_shard(path) == set) return;
  const fs::path aside = unfinished_name(path);
  std::error_code gone;
  fs::rename(path, aside, gone);
  if (gone == std::errc::no_such_file_or_directory) return;  // the other worker was faster
  if (gone)
    throw InputError(path.string(), fmt::format("cannot be removed: {}", gone.message()),
                     "change the folder's permissions or use another");
  if (set_of_shard(aside) == set)
    fs::rename(aside, path);
  else
    fs::remove(aside);
}

// Where two descriptions differ first: "seed: 0, now 1"; the name alone where values are long.
std::string first_difference_in(const Json& then, const Json& now, const std::string& name = {}) {
  constexpr std::size_t kMost = 40;
  if (then.is_object() && now.is_object()) {
    for (const auto& [key, value] : now.items())
      if (!then.contains(key) || then[key] != value)
        return first_difference_in(then.value(key, Json()), value,
                                   name.empty() ? key : fmt::format("{}.{}", name, key));
    for (const auto& [key, value] : then.items())
      if (!now.contains(key)) return name.empty() ? key : fmt::format("{}.{}", name, key);
  }
  const std::string before = json_utf8(then, -1), after = json_utf8(now, -1);
  return before.size() + after.size() > kMost ? name
                                              : fmt::format("{}: {}, now {}", name, before, after);
}

// What dataset.json, which may have been edited, says differently.
std::string difference_from(const std::string& text, const Json& description) {
  try {
    const std::string found = first_difference_in(Json::parse(text), description);
    return found.empty() ? found : fmt::format(" ({})", found);
  } catch (const Json::exception&) {
    return {};
  }
}

}  // namespace

std::string fingerprint(std::string_view bytes) {
  Fingerprint print;
  print.add(bytes);
  return print.text();
}

void prepare_dataset_folder(const fs::path& folder, const Json& description, bool force) {
  constexpr const char* kRemedy = "use another folder, or --force to replace it";
  const fs::path path = folder / "dataset.json";
  const std::string text = json_utf8(description, 2) + "\n", set = set_name(description);
  const std::vector<fs::path> shards = shards_in(folder);
  const std::optional<std::string> found = whole_text(path);
  // It is written when no shard of another set is left, so there is none.
  if (found == text) return;
  // Without a shard it is of a run that failed before its first one: nothing is lost with it.
  if (!force && found && !shards.empty())
    throw InputError(path.string(),
                     fmt::format("belongs to a data set with other settings or inputs{}",
                                 difference_from(*found, description)),
                     kRemedy);
  // dataset.json goes first: whenever this run is killed, it speaks for no shard but its own.
  if (force) fs::remove(path);
  for (const fs::path& shard : shards) {
    if (force)
      remove_shard_of_another_set(shard, set);
    else if (set_of_shard(shard) != set)
      throw InputError(shard.string(), "is of another data set, and dataset.json is missing",
                       kRemedy);
  }
  write_file(path, text, true);
}

bool shard_is_made(const fs::path& path, const std::string& set) {
  if (!fs::exists(path)) return false;
  if (set_of_shard(path) != set)
    throw InputError(path.string(), "is damaged or of another data set than dataset.json",
                     "remove it, or --force to make all shards again");
  return true;
}

}  // namespace malus::app
