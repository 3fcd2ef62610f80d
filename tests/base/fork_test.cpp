// A forked child works on the thread it has.
#include "malus/base/fork.h"

#include "malus/base/parallel.h"

#include <cstdint>
#include <numeric>
#include <vector>

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

namespace malus {
namespace {

int exit_code_of_child(int (*body)()) {
  const pid_t child = fork();
  if (child == 0) {
    work_alone();
    alarm(60);
    _exit(body());
  }
  int status = 0;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

std::int64_t sum_to(int n) {
  std::vector<std::int64_t> values(static_cast<std::size_t>(n));
  parallel_for(0, n, 7, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto i = begin; i < end; ++i) values[static_cast<std::size_t>(i)] = i;
  });
  return std::accumulate(values.begin(), values.end(), std::int64_t{0});
}

TEST(Fork, ChildrenWorkAlone) {
  ASSERT_EQ(sum_to(1000), 499500);  // the parent's threads exist
  EXPECT_EQ(exit_code_of_child([] { return sum_to(1000) == 499500 ? 0 : 1; }), 0);
  EXPECT_EQ(
      exit_code_of_child([] { return thread_count() == 1 && set_thread_count(1) == 1 ? 0 : 1; }),
      0);
  EXPECT_EQ(sum_to(1000), 499500);
}

}  // namespace
}  // namespace malus
