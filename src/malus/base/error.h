// Three kinds of failure, three idioms:
//   bad input or environment         -> throw InputError (one line: subject, problem, remedy)
//   data that cannot decide a value  -> return Estimate<T> holding Undecided (see estimate.h)
//   a bug in malus                   -> MALUS_REQUIRE throws ContractViolation, caught by nobody
#pragma once

#include <stdexcept>
#include <string>
#include <string_view>

namespace malus {

/// The input or the environment is at fault. what() is one line "subject: problem; remedy".
class InputError : public std::runtime_error {
 public:
  /// subject: the file, key or flag; problem: what is wrong, with numbers; remedy: what the user
  /// can do.
  InputError(std::string_view subject, std::string_view problem, std::string_view remedy);
  const std::string& subject() const noexcept { return subject_; }
  const std::string& problem() const noexcept { return problem_; }
  const std::string& remedy() const noexcept { return remedy_; }

 private:
  std::string subject_, problem_, remedy_;
};

/// Work was stopped by the user (Progress::stop_requested).
class Cancelled : public std::runtime_error {
 public:
  Cancelled() : std::runtime_error("stopped on request") {}
};

/// A bug in malus: a caller inside the library broke a function's contract. Never raised for bad
/// input.
class ContractViolation : public std::logic_error {
 public:
  using std::logic_error::logic_error;
};

namespace internal {
[[noreturn]] void contract_violated(const char* condition, const char* file, int line);
}

#define MALUS_REQUIRE(condition) \
  ((condition) ? void(0) : ::malus::internal::contract_violated(#condition, __FILE__, __LINE__))

}  // namespace malus
