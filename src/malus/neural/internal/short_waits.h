// Waiting for a message between workers without being deaf to anything else.
#pragma once

#include <chrono>
#include <exception>

namespace malus {

/// Until the message (c10d's Work) has ended, in waits of `each`, which throw where it has not;
/// between them look(), which may throw. Throws what went wrong with the message.
template <class Work, class Look>
void finish_in_short_waits(Work& work, std::chrono::milliseconds each, Look look) {
  for (;;) {
    try {
      work.wait(each);
      return;
    } catch (const std::exception&) {
      if (!work.isCompleted()) {
        look();
        continue;
      }
    }
    // It had failed, or ended after the wait did: then this returns at once.
    work.wait();
    return;
  }
}

}  // namespace malus
