#include "malus/neural/internal/light_cache.h"

#include "malus/base/parallel.h"

#include <exception>
#include <utility>

namespace malus {
namespace {

std::size_t bytes_of(const LightCache::Light& light) {
  std::size_t values = 0;
  for (const StokesPlanes& color : light)
    values += color.s0.size() + color.s1.size() + color.s2.size();
  return values * sizeof(float);
}

}  // namespace

std::shared_ptr<const LightCache::Light> LightCache::light(const std::filesystem::path& path,
                                                           const Read& read) {
  const std::filesystem::path name = std::filesystem::weakly_canonical(path);
  std::promise<Shared> promise;
  {
    std::unique_lock lock(mutex_);
    if (const auto found = kept_.find(name); found != kept_.end()) return found->second;
    if (const auto found = being_read_.find(name); found != being_read_.end()) {
      const std::shared_future<Shared> other = found->second;
      lock.unlock();
      return other.get();
    }
    being_read_.emplace(name, promise.get_future().share());
  }
  try {
    // A loop that waits for its other threads may begin something else on this one, which may wait
    // for this very light.
    const SerialLoops alone;
    auto light = std::make_shared<const Light>(read());
    const std::lock_guard lock(mutex_);
    keep(name, light);
    being_read_.erase(name);
    promise.set_value(light);
    return light;
  } catch (...) {
    const std::lock_guard lock(mutex_);
    being_read_.erase(name);
    promise.set_exception(std::current_exception());
    throw;
  }
}

// The mutex is held.
void LightCache::keep(const std::filesystem::path& name, const Shared& light) {
  kept_.emplace(name, light);
  order_.push_back(name);
  bytes_ += bytes_of(*light);
  while (static_cast<double>(bytes_) > memory_mib_ * 0x1p20 && order_.size() > 1) {
    const auto first = kept_.find(order_.front());
    bytes_ -= bytes_of(*first->second);
    kept_.erase(first);
    order_.pop_front();
  }
}

}  // namespace malus
