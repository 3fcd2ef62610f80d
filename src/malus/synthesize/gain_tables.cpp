#include "malus/synthesize/gain_tables.h"

#include "malus/base/error.h"

#include <algorithm>
#include <mutex>
#include <utility>

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

LevelSampler sampler_of_levels(const NoiseModel& model, const NonparametricCalibration& calibration,
                               int row_group, bool rounded_later) {
  const double lowest_black = model.black_dn.empty()
                                  ? 0.0
                                  : *std::min_element(model.black_dn.begin(), model.black_dn.end());
  const double highest_dn = (model.white_dn > 0 ? model.white_dn : kHighestInteger) - lowest_black;
  if (rounded_later && model.quantization_dn > 0)
    return {model.layout, calibration, row_group, highest_dn, {model.quantization_dn}};
  NonparametricCalibration recorded = calibration;
  for (NonparametricChannel& channel : recorded.channels)
    channel = as_recorded(std::move(channel), model.quantization_dn);
  return {model.layout, recorded, row_group, highest_dn};
}

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
