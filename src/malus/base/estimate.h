// An estimate that the data may be unable to decide: the caller has to look before it can use the
// value.
#pragma once

#include "malus/base/error.h"

#include <string>
#include <utility>
#include <variant>

namespace malus {

/// Why the data cannot decide, with the number found and the limit it missed.
struct Undecided {
  std::string reason;
};

template <class T>
class [[nodiscard]] Estimate {
 public:
  Estimate(T value) : state_(std::move(value)) {}            // NOLINT: implicit by design
  Estimate(Undecided reason) : state_(std::move(reason)) {}  // NOLINT: implicit by design

  bool decided() const noexcept { return std::holds_alternative<T>(state_); }
  explicit operator bool() const noexcept { return decided(); }
  /// The value; contract: decided().
  const T& value() const {
    MALUS_REQUIRE(decided());
    return std::get<T>(state_);
  }
  const T& operator*() const { return value(); }
  const T* operator->() const { return &value(); }
  /// The reason; contract: not decided().
  const std::string& reason() const {
    MALUS_REQUIRE(!decided());
    return std::get<Undecided>(state_).reason;
  }
  T value_or(T other) const { return decided() ? std::get<T>(state_) : std::move(other); }

 private:
  std::variant<T, Undecided> state_;
};

}  // namespace malus
