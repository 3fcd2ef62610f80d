#include "malus/synthesize/gain_tables.h"

#include <algorithm>

namespace malus {
namespace {

// A gain's tables take up to 0.3 MB of sixteen shapes, a non-parametric one's a few.
constexpr std::size_t kGainsHeld = 8;

}  // namespace

std::shared_ptr<const GainTables> GainTableCache::at(
    const GainSetting& gain, const std::function<GainTables(const GainSetting& gain)>& make) {
  {
    const std::lock_guard lock(mutex_);
    const auto found = std::find_if(recent_.begin(), recent_.end(),
                                    [&](const auto& tables) { return tables->gain == gain; });
    if (found != recent_.end()) {
      recent_.splice(recent_.begin(), recent_, found);
      return recent_.front();
    }
  }
  const auto made = std::make_shared<const GainTables>(make(gain));
  const std::lock_guard lock(mutex_);
  recent_.push_front(made);
  if (recent_.size() > kGainsHeld) recent_.pop_back();
  return made;
}

}  // namespace malus
