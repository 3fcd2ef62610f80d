// Clean light that stays in memory as far as it may, for several threads that make examples of it.
#pragma once

#include "malus/polar/stokes.h"

#include <cstddef>
#include <deque>
#include <filesystem>
#include <functional>
#include <future>
#include <map>
#include <memory>
#include <mutex>
#include <vector>

namespace malus {

class LightCache {
 public:
  using Light = std::vector<StokesPlanes>;
  using Read = std::function<Light()>;

  /// What was read is kept as far as this reaches; the first to come are the first to go, the last
  /// one stays. What is being read, and what somebody still uses, is not counted.
  explicit LightCache(double memory_mib) : memory_mib_(memory_mib) {}

  /// The light of a file or folder: kept, or read on this thread while the others use what is
  /// there. Whoever wants the same meanwhile waits, and gets this light or what `read` throws;
  /// after a failure it is read again. One that is named twice, by a link, is one. Any thread.
  std::shared_ptr<const Light> light(const std::filesystem::path& path, const Read& read);

 private:
  using Shared = std::shared_ptr<const Light>;
  void keep(const std::filesystem::path& name, const Shared& light);

  double memory_mib_;
  std::mutex mutex_;
  std::map<std::filesystem::path, Shared> kept_;
  std::deque<std::filesystem::path> order_;
  std::size_t bytes_ = 0;
  std::map<std::filesystem::path, std::shared_future<Shared>> being_read_;
};

}  // namespace malus
