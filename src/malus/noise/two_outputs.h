// A finding of calibration that a model keeps among its warnings, and that denoising repeats.
#pragma once

#include <string_view>

namespace malus {

/// How the warning begins.
inline constexpr std::string_view kTwoOutputsFinding =
    "the left and the right half of each row have noise of their own";

}  // namespace malus
