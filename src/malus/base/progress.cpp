#include "malus/base/progress.h"

#include "malus/base/error.h"

#include <fmt/format.h>

namespace malus {
namespace {

class Silent final : public Progress {
 public:
  void begin(std::string_view, std::int64_t) override {}
  void advance(std::int64_t) override {}
  void warn(std::string_view) override {}
  bool stop_requested() const override { return false; }
};

}  // namespace

void Progress::warn_of(std::string_view file, std::string_view message) {
  warn(fmt::format("{}: {}", file, message));
}

Progress& silent_progress() {
  static Silent silent;
  return silent;
}

void check_stop(const Progress& progress) {
  if (progress.stop_requested()) throw Cancelled();
}

}  // namespace malus
