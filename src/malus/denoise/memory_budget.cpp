#include "malus/denoise/internal/memory_budget.h"

#include "malus/base/error.h"
#include "malus/base/wording.h"

#include <cmath>

#include <fmt/format.h>

namespace malus::internal {
namespace {

// Measured: at 1024 MiB the program with its libraries and buffers takes 45 MiB besides.
constexpr double kPixelShare = 0.92;

}  // namespace

double MemoryBudget::bytes() const {
  return kPixelShare * memory_mib * 0x1p20 - kBytesPerValue * held_values;
}

void MemoryBudget::refuse(double needed_bytes, int rows, int cols) const {
  const double all_bytes = needed_bytes + kBytesPerValue * held_values;
  throw InputError(
      setting_name("memory"),
      fmt::format("{:.0f} MiB is too little for a frame of {} x {} pixels", memory_mib, cols, rows),
      fmt::format("give at least {:.0f} MiB", std::ceil(all_bytes / (kPixelShare * 0x1p20))));
}

}  // namespace malus::internal
