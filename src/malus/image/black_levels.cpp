#include "malus/image/black_levels.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/image/frame_statistics.h"

#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

[[noreturn]] void refuse_count(std::size_t count, const SensorLayout& layout,
                               const std::string& source) {
  throw InputError(source,
                   fmt::format("{} black levels for the {} of {}", count,
                               counted(layout.channels(), "channel"), layout.name()),
                   "give one number, or one per channel in mosaic order");
}

}  // namespace

std::vector<double> black_per_channel(const std::vector<double>& values, const SensorLayout& layout,
                                      const std::string& source) {
  const auto channels = static_cast<std::size_t>(layout.channels());
  if (values.size() == 1) return std::vector<double>(channels, values[0]);
  if (values.size() != channels) refuse_count(values.size(), layout, source);
  return values;
}

std::vector<double> blacks_for_layout(const std::vector<double>& blacks, const SensorLayout& own,
                                      const SensorLayout& layout, const std::string& source) {
  std::vector<double> moved(static_cast<std::size_t>(layout.channels()), std::nan(""));
  for (int row = 0; row < std::lcm(layout.rows(), own.rows()); ++row)
    for (int col = 0; col < std::lcm(layout.cols(), own.cols()); ++col) {
      double& place = moved[static_cast<std::size_t>(layout.channel_at(row, col))];
      const double value = blacks[static_cast<std::size_t>(own.channel_at(row, col))];
      if (std::isnan(place)) place = value;
      if (place != value)
        throw InputError(source,
                         fmt::format("tells {} black levels for its layout {}, which {} has no "
                                     "place for",
                                     blacks.size(), own.name(), layout.name()),
                         "give black, or the frame's own layout");
    }
  return moved;
}

std::vector<double> blacks_for_layout(const RawFrame& frame, const SensorLayout& layout) {
  return blacks_for_layout(frame.black_dn, frame.layout, layout, frame.source);
}

void DarkLevels::add(const RawFrame& dark) {
  constexpr double kMostOfWhite = 0.25;
  const auto channels = static_cast<std::size_t>(dark.layout.channels());
  if (frames_ == 0) {
    layout_ = dark.layout;
    sum_.assign(channels, 0.0);
  }
  if (!(dark.layout == layout_))
    throw InputError(dark.source, "has another layout than the dark frames before it",
                     "give dark frames of one camera");
  if (dark.gain.contradicts(gain_))
    throw InputError(dark.source,
                     fmt::format("was taken at {}, the dark frames before it at {}",
                                 dark.gain.text(), gain_.text()),
                     "give dark frames of one gain");
  if (!gain_.decibel()) gain_ = dark.gain;
  const std::vector<double> mean_dn = finite_means_dn(dark);
  for (std::size_t k = 0; k < channels; ++k) {
    if (std::isnan(mean_dn[k]) ||
        (!white_is_guessed(dark) && mean_dn[k] > kMostOfWhite * dark.white_dn))
      throw InputError(dark.source,
                       fmt::format("its mean, {:.4g} DN, is not that of a dark frame", mean_dn[k]),
                       "take one with the lens cap on, at the gain of the others");
    sum_[k] += mean_dn[k];
  }
  ++frames_;
}

std::vector<double> DarkLevels::black_dn() const {
  MALUS_REQUIRE(frames_ > 0);
  std::vector<double> black_dn = sum_;
  for (double& level : black_dn) level /= frames_;
  return black_dn;
}

void require_levels(const RawFrame& frame) {
  if (std::ssize(frame.black_dn) != frame.layout.channels())
    refuse_count(frame.black_dn.size(), frame.layout, frame.source);
  for (const double black : frame.black_dn)
    if (!std::isfinite(black) || !std::isfinite(frame.white_dn) ||
        (!white_is_guessed(frame) && black >= frame.white_dn))
      throw InputError(
          frame.source,
          fmt::format("black {:g} DN is not below white {:g} DN", black, frame.white_dn),
          fmt::format("check {} and {}, or the session file", setting("black"), setting("white")));
}

void require_black_of_codes(const RawFrame& frame, std::string_view type) {
  if (frame.bits == 0 || type.starts_with("int")) return;
  for (const double black : frame.black_dn)
    if (black < 0)
      throw InputError(
          frame.source,
          fmt::format("black {:g} DN is negative, its {} codes begin at 0", black, type),
          "check " + setting("black") + ", or the session file");
}

}  // namespace malus
