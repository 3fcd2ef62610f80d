#include "malus/base/error.h"

#include "malus/base/one_line.h"

#include <fmt/format.h>

namespace malus {

std::string one_line(std::string_view text) {
  std::string out;
  for (char c : text) out += static_cast<unsigned char>(c) < 0x20 || c == 0x7f ? ' ' : c;
  return out;
}

InputError::InputError(std::string_view subject, std::string_view problem, std::string_view remedy)
    : std::runtime_error(one_line(fmt::format("{}: {}; {}", subject, problem, remedy))),
      subject_(subject),
      problem_(problem),
      remedy_(remedy) {}

void internal::contract_violated(const char* condition, const char* file, int line) {
  throw ContractViolation(fmt::format("{}:{}: contract broken: {}", file, line, condition));
}

}  // namespace malus
