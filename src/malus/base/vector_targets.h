// Instruction sets that Highway compiles inner loops for; included before its headers. Left out:
// those between SSE2 and AVX2, whose processors are rare and run SSE2's code, and AVX3_DL, whose
// additions these loops do not use. Noise synthesis has a choice of its own
// (synthesize/internal/vector_targets.h).
#pragma once

#define HWY_DISABLED_TARGETS (HWY_SSSE3 | HWY_SSE4 | HWY_AVX3_DL)
