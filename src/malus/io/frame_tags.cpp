#include "malus/io/internal/frame_tags.h"

#include "malus/base/error.h"
#include "malus/base/text.h"

#include <string_view>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace malus::internal {
namespace {

constexpr std::string_view kOpening = "[malus ";

std::vector<std::string_view> split(std::string_view text, char separator) {
  std::vector<std::string_view> parts;
  while (true) {
    const auto end = text.find(separator);
    parts.push_back(text.substr(0, end));
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

std::string cell_text(const SensorLayout& layout) {
  std::string text;
  for (int channel = 0; channel < layout.channels(); ++channel) {
    if (channel > 0) text += channel % layout.cols() == 0 ? '/' : ',';
    text += layout.channel_name(channel);
  }
  return text;
}

std::optional<SensorLayout> parse_layout(std::string_view key, std::string_view value) {
  try {
    if (key == "layout") return SensorLayout::named(value);
    std::vector<std::vector<std::string>> rows;
    for (const auto row : split(value, '/')) {
      rows.emplace_back();
      for (const auto site : split(row, ',')) rows.back().emplace_back(site);
    }
    return SensorLayout::from_sites(rows);
  } catch (const InputError&) {
    return std::nullopt;  // damaged tags tell nothing
  }
}

}  // namespace

std::string frame_tags(const RawFrame& frame, const std::string& holds) {
  std::string text(kOpening);
  const auto add = [&](std::string_view key, const std::string& value) {
    if (text.size() > kOpening.size()) text += ' ';
    text += fmt::format("{}={}", key, value);
  };
  if (frame.layout_known) {
    if (frame.layout.name() == "custom")
      add("cell", cell_text(frame.layout));
    else
      add("layout", frame.layout.name());
  }
  if (frame.black_known) {
    bool uniform = true;
    for (const double black : frame.black_dn) uniform = uniform && black == frame.black_dn[0];
    if (uniform)
      add("black", fmt::format("{}", frame.black_dn.at(0)));
    else
      add("black", fmt::format("{}", fmt::join(frame.black_dn, ",")));
  }
  if (frame.white_known) add("white", fmt::format("{}", frame.white_dn));
  if (frame.gain.gain_db) add("gain_db", fmt::format("{}", *frame.gain.gain_db));
  if (frame.gain.iso) add("iso", fmt::format("{}", *frame.gain.iso));
  if (frame.exposure_s) add("exposure_s", fmt::format("{}", *frame.exposure_s));
  if (frame.mean_of > 1 && holds.empty()) add("mean_of", fmt::format("{}", frame.mean_of));
  if (!holds.empty()) add("holds", holds);
  return text.size() > kOpening.size() ? text + "]" : std::string();
}

std::string content_tag(const std::string& holds) {
  return holds.empty() ? std::string() : fmt::format("{}holds={}]", kOpening, holds);
}

void apply_frame_tags(Decoded& decoded) {
  const std::string_view text = decoded.description;
  const auto begin = text.find(kOpening);
  if (begin == std::string_view::npos) return;
  const auto end = text.find(']', begin);
  if (end == std::string_view::npos) return;
  const auto body = text.substr(begin + kOpening.size(), end - begin - kOpening.size());
  for (const auto entry : split(body, ' ')) {
    const auto equals = entry.find('=');
    if (equals == std::string_view::npos) continue;
    const auto key = entry.substr(0, equals), value = entry.substr(equals + 1);
    if (key == "layout" || key == "cell") {
      decoded.layout = parse_layout(key, value);
    } else if (key == "holds") {
      decoded.holds = value;
    } else if (key == "black") {
      decoded.black_dn.clear();
      for (const auto part : split(value, ','))
        if (const auto black = decimal_number(part)) decoded.black_dn.push_back(*black);
    } else if (const auto number = decimal_number(value)) {
      if (key == "white") decoded.white_dn = number;
      if (key == "gain_db") decoded.gain.gain_db = number;
      if (key == "iso" && *number > 0) decoded.gain.iso = number;
      if (key == "exposure_s" && *number >= 0) decoded.exposure_s = number;
      if (key == "mean_of" && *number >= 1 && *number <= kMostAveraged)
        decoded.mean_of = static_cast<int>(*number);
    }
  }
  if (decoded.gain.gain_db) decoded.gain.iso.reset();
}

}  // namespace malus::internal
