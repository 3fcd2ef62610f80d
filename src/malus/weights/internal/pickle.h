// Reads the pickles that torch.save writes (protocols 2 to 5) without running anything: names of
// classes and functions are only compared with the few that weights need, everything else is kept
// as an opaque value. Format: Python's pickletools.
#pragma once

#include <cstddef>
#include <cstdint>
#include <deque>
#include <span>
#include <string>
#include <utility>
#include <vector>

namespace malus {

/// View of a part of a file with raw values.
struct PickleTensor {
  std::string dtype;  ///< of safetensors: "F32", "F16", "BF16", "I64"; also "F64", "I32", "U8";
                      ///< "" for any other
  std::string key;    ///< name of the archive's entry with the values
  std::int64_t offset = 0;                  ///< in elements
  std::vector<std::int64_t> shape, stride;  ///< stride in elements
};

struct PickleValue {
  enum class Kind { kOther, kNumber, kText, kSequence, kTable, kName, kStorage, kTensor };
  Kind kind = Kind::kOther;
  std::int64_t number = 0;          ///< of whole numbers and truth values
  std::string text;                 ///< of texts, and "module name" of names
  std::vector<PickleValue*> items;  ///< of tuples and lists
  std::vector<std::pair<PickleValue*, PickleValue*>> table;
  PickleTensor tensor;  ///< of tensors; of storages dtype and key alone
};

/// All values of a pickle. They point at each other as the pickle says, in circles too, so they
/// belong to the whole and not to each other.
struct Pickle {
  std::deque<PickleValue> values;
  const PickleValue* root = nullptr;
};

/// A whole pickle; name is for messages. Every length is checked before it is used, and what a
/// small file could be made to unfold to is limited. Throws InputError.
Pickle parse_pickle(std::span<const std::byte> bytes, const std::string& name);

}  // namespace malus
