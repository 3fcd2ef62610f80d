// The folder of a data set: its shards, and dataset.json, which says what they were made of. Every
// sample names its set, so that shards of two sets are told apart however a run ended.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>

#include "program.h"
#include <nlohmann/json.hpp>

namespace malus::app {

/// 16 hexadecimal digits that differ where the bytes do: FNV-1a of 64 bits, against mistakes, not
/// against somebody who wants two files to look the same.
std::string fingerprint(std::string_view bytes);

/// The key of a sample's facts under which the set's name stands.
inline constexpr const char* kSetKey = "data_set";

/// What a set is named by: everything that its pixels follow from.
inline std::string set_name(const nlohmann::ordered_json& description) {
  return fingerprint(json_utf8(description, -1));
}

/// Makes the folder one of this data set: dataset.json holds the description and there is no shard
/// of another set. Throws InputError where the folder holds another set and force is false. Safe
/// for several workers at a time, and for one that is killed at any instant.
void prepare_dataset_folder(const std::filesystem::path& folder,
                            const nlohmann::ordered_json& description, bool force);

/// Whether a shard is there already. Throws InputError where it is damaged or of another set.
bool shard_is_made(const std::filesystem::path& path, const std::string& set);

}  // namespace malus::app
