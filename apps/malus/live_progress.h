// A progress bar with a remark behind it that changes while the work goes on.
#pragma once

#include <memory>
#include <mutex>
#include <string>
#include <utility>

#include "program.h"

namespace malus::app {

class Remark {
 public:
  void set(std::string text) {
    const std::lock_guard lock(mutex_);
    text_ = std::move(text);
  }
  std::string text() const {
    const std::lock_guard lock(mutex_);
    return text_;
  }

 private:
  mutable std::mutex mutex_;
  std::string text_;
};

/// As make_progress; the remark is shown whenever the bar is drawn.
std::unique_ptr<Progress> make_live_progress(const Common& common,
                                             std::shared_ptr<const Remark> remark);

}  // namespace malus::app
