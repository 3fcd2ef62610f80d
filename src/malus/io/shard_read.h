// Reading the tar shards that TarShard writes (and any plain ustar archive of small files).
#pragma once

#include "malus/image/view.h"

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

namespace malus {

struct ShardEntry {
  std::string name;
  std::uint64_t offset = 0, size = 0;  ///< of the content, in bytes
};

/// All regular files in a tar archive, in order. Headers are checked: magic, checksum, sizes inside
/// the file; and that the archive ends with its block of zeros. Throws InputError.
std::vector<ShardEntry> shard_entries(const std::filesystem::path& path);

/// One file's content. Throws InputError.
std::string shard_content(const std::filesystem::path& path, const ShardEntry& entry);

/// A .npy file's bytes as planes [channel, row, column]; name is for messages. Throws InputError.
Planes planes_of_npy(const std::string& content, const std::string& name);

}  // namespace malus
