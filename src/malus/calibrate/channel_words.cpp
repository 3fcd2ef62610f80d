#include "malus/calibrate/internal/channel_words.h"

#include "malus/base/text.h"

#include <algorithm>
#include <charconv>
#include <regex>

#include <fmt/format.h>

namespace malus {
namespace {

// With a decimal point in any locale: where a comma is set, the C library's functions stop there.
double number_of(const std::string& text) {
  double number = 0;
  std::from_chars(text.data(), text.data() + text.size(), number);
  return number;
}

}  // namespace

std::string channels_text(const std::vector<std::string>& names, const SensorLayout& layout) {
  if (names.size() > 1 && std::ssize(names) == layout.channels())
    return fmt::format("all {} channels", names.size());
  return joined(names);
}

void ChannelTroubles::add(const std::string& channel, const std::string& text) {
  static const std::regex kNumber(R"(-?\d+(\.\d+)?(e[+-]?\d+)?)");
  std::vector<std::string> words, numbers;
  for (std::sregex_token_iterator part(text.begin(), text.end(), kNumber, {-1, 0}), end;
       part != end; ++part)
    (words.size() == numbers.size() ? words : numbers).push_back(*part);
  const auto same = std::ranges::find(troubles_, words, &Trouble::words);
  if (same == troubles_.end()) {
    troubles_.push_back({std::move(words), {}, {channel}});
    for (const std::string& number : numbers) troubles_.back().numbers.push_back({number, number});
    return;
  }
  same->channels.push_back(channel);
  for (std::size_t i = 0; i < numbers.size(); ++i) {
    Number& range = same->numbers[i];
    if (number_of(numbers[i]) < number_of(range.low)) range.low = numbers[i];
    if (number_of(numbers[i]) > number_of(range.high)) range.high = numbers[i];
  }
}

std::vector<std::string> ChannelTroubles::lines(const SensorLayout& layout) const {
  std::vector<std::string> lines;
  for (const Trouble& trouble : troubles_) {
    std::string line = channels_text(trouble.channels, layout) + ": ";
    for (std::size_t i = 0; i < trouble.words.size(); ++i) {
      line += trouble.words[i];
      if (i >= trouble.numbers.size()) continue;
      const Number& number = trouble.numbers[i];
      line += number.low == number.high ? number.low : number.low + " to " + number.high;
    }
    lines.push_back(std::move(line));
  }
  return lines;
}

}  // namespace malus
