#include "malus/io/pair_list.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/unreadable_file.h"
#include "malus/io/frame_stack.h"
#include "malus/io/gain_json.h"
#include "malus/io/picture_file.h"

#include <cmath>
#include <fstream>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

RecordedPair pair_of(const Json& entry, const fs::path& list) {
  for (const char* key : {"short", "reference", "ratio"})
    if (!entry.contains(key))
      throw InputError(list.string(),
                       fmt::format("the pair \"{}\" has no \"{}\"", entry.value("name", ""), key),
                       "make the list with malus pairs");
  const auto file = [&](const char* key) {
    return list.parent_path() / entry.at(key).get<std::string>();
  };
  RecordedPair pair{.name = entry.value("name", ""),
                    .noisy = file("short"),
                    .reference = file("reference"),
                    .picture = entry.contains("picture") ? file("picture") : fs::path(),
                    .ratio = entry.at("ratio").get<double>(),
                    .gain = checked_gain_from(entry, list.string())};
  const bool holds_bias = !entry.value("bias_removed", true);
  if (holds_bias || entry.contains("reference_gain"))
    pair.reference_gain = checked_gain_from(entry.at("reference_gain"), list.string());
  if (holds_bias) pair.bias_at = pair.reference_gain;
  if (frame_identity(pair.noisy) == frame_identity(pair.reference))
    throw InputError(list.string(),
                     fmt::format("the pair \"{}\" has one file, {}, as short and as reference",
                                 pair.name, pair.noisy.string()),
                     "a reference is a cleaner frame of the scene: make the list with malus pairs");
  if (!std::isfinite(pair.ratio) || pair.ratio <= 0)
    throw InputError(list.string(), fmt::format("has the low-light ratio {}", pair.ratio),
                     "a ratio is above 0");
  return pair;
}

}  // namespace

std::string RecordedPair::scene() const { return name.substr(0, name.rfind('_')); }

std::vector<RecordedPair> load_pair_list(const fs::path& list) {
  std::ifstream in(list);
  if (!in || fs::is_directory(list)) throw unreadable_file(list);
  try {
    const Json json = Json::parse(in);
    std::vector<RecordedPair> pairs;
    for (const Json& entry : json.at("pairs")) pairs.push_back(pair_of(entry, list));
    return pairs;
  } catch (const Json::exception& error) {
    throw InputError(list.string(), fmt::format("is no list of pairs ({})", error.what()),
                     "make it with malus pairs");
  }
}

Planes load_colors(const RecordedPair& pair) {
  MALUS_REQUIRE(!pair.picture.empty());
  Planes planes = load_picture(pair.picture).planes;
  if (planes.channels() != 3)
    throw InputError(pair.picture.string(), fmt::format("has {} planes", planes.channels()),
                     "a pair's picture has three: R, G and B");
  return planes;
}

void save_pair_list(const std::vector<RecordedPair>& pairs, const fs::path& list) {
  Json entries = Json::array();
  for (const RecordedPair& pair : pairs) {
    entries.push_back({{"name", pair.name},
                       {"reference", fs::absolute(pair.reference).string()},
                       {"short", fs::absolute(pair.noisy).string()},
                       {"ratio", pair.ratio}});
    entries.back().update(gain_json(pair.gain));
    entries.back()["bias_removed"] = !pair.bias_at;
    if (const auto& gain = pair.bias_at ? pair.bias_at : pair.reference_gain)
      entries.back()["reference_gain"] = gain_json(*gain);
    if (!pair.picture.empty()) entries.back()["picture"] = fs::absolute(pair.picture).string();
  }
  std::string text;
  try {
    text = Json{{"pairs", entries}}.dump(2) + "\n";
  } catch (const Json::type_error&) {  // replaced bytes would name other files
    throw InputError(list.string(), "would name files whose names are not UTF-8, as JSON is",
                     "rename the files or their folder");
  }
  write_file(list, text, true);
}

}  // namespace malus
