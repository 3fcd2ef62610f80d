// Weight files: a JSON header and raw little-endian tensors; nothing in them can run (format:
// huggingface/safetensors).
#pragma once

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <span>
#include <string>
#include <vector>

namespace malus {

/// Of a tensor in a weight file of any kind: networks need five.
inline constexpr std::size_t kMostDimensions = 8;

struct StoredTensor {
  std::string dtype;  ///< "F32", "F16", "BF16", "I64"
  std::vector<std::int64_t> shape;
  std::vector<std::byte> bytes;  ///< row-major
};

struct TensorFile {
  std::map<std::string, std::string> metadata;
  std::map<std::string, StoredTensor> tensors;
};

/// Bytes of one element; 0 for a type that is not read.
std::size_t dtype_size(const std::string& dtype);

/// Parses a whole file's bytes; name is for messages. Every offset, size and count is checked
/// before it is used; tensors must tile the data without gaps or overlaps. Throws InputError.
TensorFile parse_tensor_file(std::span<const std::byte> bytes, const std::string& name);
TensorFile load_tensor_file(const std::filesystem::path& path);

/// The bytes of a weight file. Throws InputError.
std::vector<std::byte> read_weight_file(const std::filesystem::path& path);

/// Writes beside the final name and renames. Throws InputError.
void save_tensor_file(const TensorFile& file, const std::filesystem::path& path);

}  // namespace malus
