// The table of weights in a file of torch.save (.pth, .pt; PyTorch 1.6 or newer), read without
// running anything in it. Needs no libtorch.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

namespace malus {

/// One weight: a view of stored values, checked to lie inside them.
struct ArchivedTensor {
  std::string name;
  std::string dtype;                        ///< "F32", "F16", "BF16", "F64", "I64", "I32", "U8"
  std::vector<std::int64_t> shape, stride;  ///< stride in elements, from the first value
  /// From the first value of the view to its last, little-endian; unaligned. Empty where a size
  /// is 0.
  std::span<const std::byte> values;
};

/// The weights of an archive; they live as long as its bytes. Where it holds a table of several
/// things they are looked for under params_ema, params, state_dict, model_state_dict, model,
/// weights, in this order; a "module." before all names (DataParallel) is taken away. All views
/// together are limited to a few times the file's size. check_sums = false leaves the archive's
/// checksums alone (for fuzzing). Throws InputError.
std::vector<ArchivedTensor> parse_torch_archive(std::span<const std::byte> bytes,
                                                const std::string& name, bool check_sums = true);

}  // namespace malus
