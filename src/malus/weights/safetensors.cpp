#include "malus/weights/safetensors.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/unreadable_file.h"

#include <algorithm>
#include <cstring>
#include <fstream>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace malus {
namespace {

using Json = nlohmann::json;

constexpr std::uint64_t kLargestHeader = 100u << 20;  // the format's own limit
constexpr const char* kGiveAWeightFile =
    "give a .safetensors file that malus train or an import wrote";

struct Extent {
  std::uint64_t begin, end;
  std::string tensor;
};

std::uint64_t element_count(const std::vector<std::int64_t>& shape, const std::string& name,
                            const std::string& tensor) {
  std::uint64_t count = 1;
  for (std::int64_t size : shape) {
    if (size < 0 ||
        (size > 0 && count > (std::uint64_t{1} << 40) / static_cast<std::uint64_t>(size)))
      throw InputError(name, fmt::format("tensor \"{}\" has an impossible shape", tensor),
                       kGiveAWeightFile);
    count *= static_cast<std::uint64_t>(size);
  }
  return count;
}

StoredTensor read_tensor(const Json& entry, std::span<const std::byte> data,
                         const std::string& name, const std::string& tensor,
                         std::vector<Extent>& extents) {
  StoredTensor out;
  out.dtype = entry.at("dtype").get<std::string>();
  out.shape = entry.at("shape").get<std::vector<std::int64_t>>();
  const auto offsets = entry.at("data_offsets").get<std::vector<std::uint64_t>>();
  const std::size_t size = dtype_size(out.dtype);
  if (size == 0)
    throw InputError(name, fmt::format("tensor \"{}\" has type \"{}\"", tensor, out.dtype),
                     "store it as F32, F16, BF16 or I64");
  if (out.shape.size() > kMostDimensions || offsets.size() != 2 || offsets[0] > offsets[1] ||
      offsets[1] > data.size() ||
      offsets[1] - offsets[0] != element_count(out.shape, name, tensor) * size)
    throw InputError(name, fmt::format("tensor \"{}\" does not fit its place in the file", tensor),
                     kGiveAWeightFile);
  const auto bytes = data.subspan(offsets[0], offsets[1] - offsets[0]);
  out.bytes.assign(bytes.begin(), bytes.end());
  extents.push_back({offsets[0], offsets[1], tensor});
  return out;
}

void check_tiling(std::vector<Extent> extents, std::uint64_t data_size, const std::string& name) {
  std::sort(extents.begin(), extents.end(), [](const auto& a, const auto& b) {
    return a.begin != b.begin ? a.begin < b.begin : a.end < b.end;
  });
  std::uint64_t position = 0;
  for (const auto& extent : extents) {
    if (extent.begin != position)
      throw InputError(name,
                       fmt::format("tensor \"{}\" overlaps another or leaves a gap", extent.tensor),
                       kGiveAWeightFile);
    position = extent.end;
  }
  if (position != data_size)
    throw InputError(name, fmt::format("{} bytes after the last tensor", data_size - position),
                     kGiveAWeightFile);
}

}  // namespace

std::size_t dtype_size(const std::string& dtype) {
  if (dtype == "F32") return 4;
  if (dtype == "F16" || dtype == "BF16") return 2;
  if (dtype == "I64") return 8;
  return 0;
}

TensorFile parse_tensor_file(std::span<const std::byte> bytes, const std::string& name) {
  std::uint64_t header_size = 0;
  if (bytes.size() < sizeof header_size)
    throw InputError(name, fmt::format("only {} bytes", bytes.size()), kGiveAWeightFile);
  std::memcpy(&header_size, bytes.data(), sizeof header_size);
  if (header_size > kLargestHeader || header_size > bytes.size() - sizeof header_size)
    throw InputError(name,
                     fmt::format("its header claims {} bytes of {}", header_size, bytes.size()),
                     kGiveAWeightFile);
  const auto* text = reinterpret_cast<const char*>(bytes.data()) + sizeof header_size;
  const auto data = bytes.subspan(sizeof header_size + header_size);
  TensorFile file;
  std::vector<Extent> extents;
  try {
    const Json header = Json::parse(text, text + header_size);
    if (!header.is_object())
      throw InputError(name, "its header is not a JSON object", kGiveAWeightFile);
    for (const auto& [key, entry] : header.items()) {
      if (key == "__metadata__")
        file.metadata = entry.get<std::map<std::string, std::string>>();
      else
        file.tensors[key] = read_tensor(entry, data, name, key, extents);
    }
  } catch (const Json::exception& error) {
    throw InputError(name,
                     fmt::format("its header is not what the format asks for ({})", error.what()),
                     kGiveAWeightFile);
  }
  check_tiling(std::move(extents), data.size(), name);
  return file;
}

std::vector<std::byte> read_weight_file(const std::filesystem::path& path) {
  std::error_code error;
  const auto fail = [&] { throw unreadable_file(path); };
  if (!std::filesystem::is_regular_file(path, error)) fail();
  std::ifstream in(path, std::ios::binary);
  const std::uintmax_t size = std::filesystem::file_size(path, error);
  if (!in || error) fail();
  std::vector<std::byte> bytes(size);
  if (!in.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size))) fail();
  return bytes;
}

TensorFile load_tensor_file(const std::filesystem::path& path) {
  return parse_tensor_file(read_weight_file(path), path.string());
}

void save_tensor_file(const TensorFile& file, const std::filesystem::path& path) {
  Json header;
  header["__metadata__"] = file.metadata;
  std::uint64_t position = 0;
  for (const auto& [name, tensor] : file.tensors) {
    header[name] = {{"dtype", tensor.dtype},
                    {"shape", tensor.shape},
                    {"data_offsets", {position, position + tensor.bytes.size()}}};
    position += tensor.bytes.size();
  }
  std::string text = header.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');  // tensors start aligned
  const std::uint64_t size = text.size();
  AtomicFile file_on_disk(path, true);
  std::ofstream out(file_on_disk.temporary(), std::ios::binary);
  out.write(reinterpret_cast<const char*>(&size), sizeof size);
  out << text;
  for (const auto& [name, tensor] : file.tensors)
    out.write(reinterpret_cast<const char*>(tensor.bytes.data()),
              static_cast<std::streamsize>(tensor.bytes.size()));
  out.close();
  if (!out) file_on_disk.fail();
  file_on_disk.commit();
}

}  // namespace malus
