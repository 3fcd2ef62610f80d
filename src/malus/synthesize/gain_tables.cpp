#include "malus/synthesize/gain_tables.h"

#include "malus/base/error.h"

#include <algorithm>
#include <mutex>

#include <pthread.h>

namespace malus {
namespace {

// A gain's tables take up to 0.3 MB of sixteen shapes, a non-parametric one's a few.
constexpr std::size_t kGainsHeld = 8;

// One for all caches, which are held for moments only: a fork waits for it, or the child would find
// it held for ever by a thread that it does not have.
std::mutex cache_mutex;

// Registered while the program is loaded: later, a fork could meet it half done.
const int fork_handlers = pthread_atfork([] { cache_mutex.lock(); }, [] { cache_mutex.unlock(); },
                                         [] { cache_mutex.unlock(); });

}  // namespace

std::shared_ptr<const GainTables> GainTableCache::at(
    const GainSetting& gain, const std::function<GainTables(const GainSetting& gain)>& make) {
  MALUS_REQUIRE(fork_handlers == 0);
  {
    const std::lock_guard lock(cache_mutex);
    const auto found = std::find_if(recent_.begin(), recent_.end(),
                                    [&](const auto& tables) { return tables->gain == gain; });
    if (found != recent_.end()) {
      recent_.splice(recent_.begin(), recent_, found);
      return recent_.front();
    }
  }
  const auto made = std::make_shared<const GainTables>(make(gain));
  const std::lock_guard lock(cache_mutex);
  recent_.push_front(made);
  if (recent_.size() > kGainsHeld) recent_.pop_back();
  return made;
}

}  // namespace malus
