#include "malus/weights/torch_archive.h"

#include "malus/base/error.h"
#include "malus/weights/internal/pickle.h"
#include "malus/weights/internal/stored_zip.h"

#include <algorithm>
#include <set>
#include <string_view>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

using Kind = PickleValue::Kind;

constexpr const char* kSaveAgain = "save the state dict again with torch.save";
constexpr std::size_t kLargestPickle = 64u << 20;
// Weights may share their values (tied layers), but a small file must not unfold to a large one.
constexpr std::size_t kMostReuse = 4;
constexpr std::size_t kLongestKey = 1024;
constexpr std::int64_t kLongestSide = std::int64_t{1} << 31;

std::int64_t element_size(const std::string& dtype) {
  if (dtype == "F64" || dtype == "I64") return 8;
  if (dtype == "F32" || dtype == "I32") return 4;
  return dtype == "U8" ? 1 : 2;
}

// PyTorch before 1.6 wrote pickles (protocol 2) one after the other, without an archive.
std::span<const std::byte> not_legacy(std::span<const std::byte> bytes, const std::string& name) {
  if (bytes.size() > 1 && bytes[0] == std::byte{0x80} && bytes[1] == std::byte{2})
    throw InputError(
        name, "is in the format of PyTorch before 1.6",
        "load it there, and save the state dict again with torch.save of 1.6 or newer");
  return bytes;
}

class Archive {
 public:
  Archive(std::span<const std::byte> bytes, const std::string& name, bool check_sums)
      : name_(name),
        check_sums_(check_sums),
        entries_(parse_stored_zip(not_legacy(bytes, name), name)) {
    // All entries lie in one folder, whose name is the file's first one.
    constexpr std::string_view kPickle = "/data.pkl";
    for (const auto& [entry, unused] : entries_)
      if (entry.ends_with(kPickle) && entry.find('/') == entry.size() - kPickle.size())
        folder_ = entry.substr(0, entry.size() - kPickle.size() + 1);
    if (folder_.empty()) fail("is no archive of torch.save (PyTorch 1.6 or newer)");
    if (const auto order = entries_.find(folder_ + "byteorder");
        order != entries_.end() && !order->second.bytes.empty() &&
        order->second.bytes[0] != std::byte{'l'})
      fail("was written on a big-endian machine");
  }

  std::span<const std::byte> entry(const std::string& inside) {
    const auto found = entries_.find(folder_ + inside);
    if (found == entries_.end()) fail(fmt::format("lacks its entry \"{}\"", inside));
    if (check_sums_ && checked_.insert(inside).second && !intact(found->second))
      fail(fmt::format("is damaged: \"{}\" differs from its checksum", inside));
    return found->second.bytes;
  }
  [[noreturn]] void fail(const std::string& problem) const {
    throw InputError(name_, problem, kSaveAgain);
  }

 private:
  const std::string& name_;
  bool check_sums_;
  std::map<std::string, ZipEntry> entries_;
  std::set<std::string> checked_;
  std::string folder_;
};

// A view checked against its storage, which reaches from its first value to its last.
ArchivedTensor tensor_of(const std::string& name, const PickleTensor& stored, Archive& archive) {
  const auto fail = [&](const char* problem) {
    archive.fail(fmt::format("weight \"{}\" {}", name, problem));
  };
  if (stored.dtype.empty()) fail("has a type that weights do not have");
  const auto storage = archive.entry("data/" + stored.key);
  const std::int64_t size = element_size(stored.dtype);
  const std::int64_t available = static_cast<std::int64_t>(storage.size()) / size;
  if (stored.offset < 0 || stored.offset > available) fail("reaches beyond its data");
  ArchivedTensor tensor{name, stored.dtype, stored.shape, stored.stride, {}};
  for (std::size_t i = 0; i < stored.shape.size(); ++i)
    if (stored.shape[i] < 0 || stored.stride[i] < 0 || stored.shape[i] > kLongestSide)
      fail("has no proper shape");
  if (std::find(stored.shape.begin(), stored.shape.end(), 0) != stored.shape.end()) return tensor;
  std::int64_t count = 1, last = stored.offset;
  for (std::size_t i = 0; i < stored.shape.size(); ++i) {
    const std::int64_t steps = stored.shape[i] - 1, stride = stored.stride[i];
    if (steps > 0 && stride > (available - last) / steps) fail("reaches beyond its data");
    last += stride * steps;
    if (stored.shape[i] > available / count) fail("is larger than its data");
    count *= stored.shape[i];
  }
  if (last >= available) fail("reaches beyond its data");
  // More elements than places: they overlap, and the tensor could be of any size.
  if (count > last - stored.offset + 1) fail("is larger than its data");
  tensor.values = storage.subspan(static_cast<std::size_t>(stored.offset * size),
                                  static_cast<std::size_t>((last - stored.offset + 1) * size));
  return tensor;
}

using NamedTensors = std::vector<std::pair<std::string, const PickleTensor*>>;

// Every tensor of a table by its key; empty where it holds none.
NamedTensors tensors_in(const PickleValue& value, const Archive& archive) {
  NamedTensors tensors;
  for (const auto& [key, item] : value.table) {
    if (key->kind != Kind::kText || item->kind != Kind::kTensor) continue;
    if (key->text.size() > kLongestKey) archive.fail("holds a name without end");
    tensors.emplace_back(key->text, &item->tensor);
  }
  return tensors;
}

// Under a name that checkpoints give it; else the content itself: tensors beside such a table, a
// loss for one, are no weights.
NamedTensors weights_in(const PickleValue& value, const Archive& archive) {
  NamedTensors tensors;
  for (const char* name :
       {"params_ema", "params", "state_dict", "model_state_dict", "model", "weights"})
    for (const auto& [key, item] : value.table)
      if (tensors.empty() && key->text == name) tensors = tensors_in(*item, archive);
  if (tensors.empty()) tensors = tensors_in(value, archive);
  if (tensors.empty()) archive.fail("holds no table of weights");
  constexpr std::string_view kParallel = "module.";
  if (std::all_of(tensors.begin(), tensors.end(),
                  [&](const auto& t) { return t.first.starts_with(kParallel); }))
    for (auto& tensor : tensors) tensor.first.erase(0, kParallel.size());
  return tensors;
}

}  // namespace

std::vector<ArchivedTensor> parse_torch_archive(std::span<const std::byte> bytes,
                                                const std::string& name, bool check_sums) {
  Archive archive(bytes, name, check_sums);
  const auto content = archive.entry("data.pkl");
  if (content.size() > kLargestPickle) archive.fail("holds a larger table than weights have");
  const Pickle pickle = parse_pickle(content, name + " (data.pkl)");
  std::vector<ArchivedTensor> tensors;
  std::size_t total = 0;
  for (const auto& [weight, stored] : weights_in(*pickle.root, archive)) {
    tensors.push_back(tensor_of(weight, *stored, archive));
    total += tensors.back().values.size();
    if (total > kMostReuse * bytes.size()) archive.fail("repeats its values without end");
  }
  return tensors;
}

}  // namespace malus
