#include "malus/base/frame_numbers.h"

#include "malus/base/error.h"

#include <gtest/gtest.h>

namespace malus {
namespace {

TEST(FrameNumbers, EndAtTheLast32BitNumber) {
  EXPECT_NO_THROW(require_numbers_left("frame", 4294967295u, 1));
  EXPECT_NO_THROW(require_numbers_left("frame", 4294967293u, 3));
  EXPECT_NO_THROW(require_numbers_left("frame", 4294967295u, 0));
  EXPECT_THROW(require_numbers_left("frame", 4294967294u, 3), InputError);
}

}  // namespace
}  // namespace malus
