// Instruction sets that the vector kernels are compiled for; included before highway's headers.
// Wrappers with operators need vector types of known size, and one rounding per multiply-add needs
// a fused unit: older x86 and all else run the scalar twin.
#pragma once

// The twin is written for HWY_SCALAR. Where the compiler is able to, Highway's choice for all else
// would be HWY_EMU128: GCC before 12.3 is not, clang is.
#ifndef HWY_BROKEN_EMU128
#define HWY_BROKEN_EMU128 1
#endif

#define HWY_DISABLED_TARGETS \
  (HWY_SVE | HWY_SVE2 | HWY_SVE_256 | HWY_SVE2_128 | HWY_RVV | HWY_SSSE3 | HWY_SSE4 | HWY_EMU128)
