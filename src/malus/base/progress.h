// How long work tells its caller where it is, and how the caller stops it. The library never
// prints.
#pragma once

#include <cstdint>
#include <string_view>

namespace malus {

/// Implemented by the caller (a terminal bar, a Python callback). All functions may be called from
/// any thread.
class Progress {
 public:
  virtual ~Progress() = default;
  /// A stage begins; total is in steps of the stage's own kind (frames, tiles, iterations).
  virtual void begin(std::string_view stage, std::int64_t total) = 0;
  virtual void advance(std::int64_t steps) = 0;
  virtual void warn(std::string_view message) = 0;
  /// The same of a file: "file: message" by default. Who works on many may say it once of all.
  virtual void warn_of(std::string_view file, std::string_view message);
  /// What a user may like to know and need not act on; said nowhere by default.
  virtual void note(std::string_view /*message*/) {}
  /// The work checks this between steps and throws Cancelled.
  virtual bool stop_requested() const = 0;
};

/// Says nothing, never stops: the default.
Progress& silent_progress();

/// Throws Cancelled when a stop was requested.
void check_stop(const Progress& progress);

}  // namespace malus
