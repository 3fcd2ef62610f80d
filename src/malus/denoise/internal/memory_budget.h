// What the setting memory leaves for pixels, and one refusal for all methods.
#pragma once

namespace malus::internal {

/// Bytes for frames, tiles and planes; the program itself takes the rest.
double pixel_budget_bytes(double memory_mib);

/// Throws InputError that says how much memory the frame would need.
[[noreturn]] void refuse_memory(double memory_mib, double needed_bytes, int rows, int cols);

}  // namespace malus::internal
