// How warnings name channels: one line for all that have the same trouble.
#pragma once

#include "malus/image/layout.h"

#include <string>
#include <vector>

namespace malus {

/// "R0, R45"; "all 16 channels" where no channel of several is missing.
std::string channels_text(const std::vector<std::string>& names, const SensorLayout& layout);

/// Troubles of single channels, gathered.
class ChannelTroubles {
 public:
  /// Channels whose texts differ in numbers alone are told of together.
  void add(const std::string& channel, const std::string& text);
  /// One line per trouble, in the order they came in; a number that differs becomes its range:
  /// "R0, B0: the noise is 0.2 to 0.3 DN".
  std::vector<std::string> lines(const SensorLayout& layout) const;

 private:
  struct Number {
    std::string low, high;  ///< as they were written
  };
  struct Trouble {
    std::vector<std::string> words;  ///< between the numbers, one more than these
    std::vector<Number> numbers;
    std::vector<std::string> channels;
  };
  std::vector<Trouble> troubles_;
};

}  // namespace malus
