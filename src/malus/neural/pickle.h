// Reads the pickles that torch.save writes (protocols 2 to 5) without running anything: names of
// classes and functions are only compared with the few that weights need, everything else is kept
// as an opaque value. Format: Python's pickletools.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace malus {

struct PickleValue;
using PicklePointer = std::shared_ptr<PickleValue>;

/// Part of a file with raw values that tensors are views of.
struct PickleStorage {
  std::string dtype;  ///< of safetensors: "F32", "F16", "BF16", "I64", "F64", "I32", "U8"
  std::string key;    ///< name of the archive's entry
};

struct PickleTensor {
  PickleStorage storage;
  std::int64_t offset = 0;  ///< in elements
  std::vector<std::int64_t> shape, stride;
};

struct PickleValue {
  enum class Kind { kOther, kNumber, kText, kSequence, kTable, kName, kStorage, kTensor };
  Kind kind = Kind::kOther;
  std::int64_t number = 0;           ///< of whole numbers and truth values
  std::string text;                  ///< of texts, and "module name" of names
  std::vector<PicklePointer> items;  ///< of tuples and lists
  std::vector<std::pair<PicklePointer, PicklePointer>> table;
  PickleStorage storage;
  PickleTensor tensor;
};

/// The value of a whole pickle; name is for messages. Every length is checked before it is used.
/// Throws InputError.
PicklePointer parse_pickle(std::span<const std::byte> bytes, const std::string& name);

}  // namespace malus
