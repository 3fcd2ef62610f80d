// Results of one computation on all instruction sets that this machine has.
#pragma once

#include "malus/image/view.h"

#include <cstdint>

#include <gtest/gtest.h>
#include <hwy/targets.h>

namespace malus {

/// The same bits on all that multiply and add in one rounding; on others `rounding` away. (A kernel
/// that is not compiled for a set runs without any.)
template <class Compute>
void expect_same_on_every_instruction_set(const Compute& compute, double rounding) {
  const Image expected = compute();
  for (std::int64_t rest = hwy::SupportedTargets(); rest != 0; rest &= rest - 1) {
    const std::int64_t target = rest & -rest;
    hwy::SetSupportedTargetsForTest(target);
    const Image result = compute();
    if (!HWY_ARCH_X86 || (target & (HWY_AVX2 | HWY_AVX3))) {
      EXPECT_EQ(result, expected) << hwy::TargetName(target);
      continue;
    }
    for (std::size_t i = 0; i < result.size(); ++i)
      ASSERT_NEAR(result.values()[i], expected.values()[i], rounding) << hwy::TargetName(target);
  }
  hwy::SetSupportedTargetsForTest(0);
}

}  // namespace malus
