#include "malus/image/black_levels.h"

#include "malus/base/error.h"

#include <numeric>

#include <fmt/format.h>

namespace malus {

std::vector<double> black_per_channel(const std::vector<double>& values, const SensorLayout& layout,
                                      const std::string& source) {
  const auto channels = static_cast<std::size_t>(layout.channels());
  if (values.size() == 1) return std::vector<double>(channels, values[0]);
  if (values.size() != channels)
    throw InputError(source,
                     fmt::format("{} black levels for the {} channels of {}", values.size(),
                                 channels, layout.name()),
                     "give one number, or one per channel in mosaic order");
  return values;
}

std::vector<double> blacks_for_layout(const RawFrame& frame, const SensorLayout& layout) {
  std::vector<double> blacks;
  for (int r = 0; r < layout.rows(); ++r)
    for (int c = 0; c < layout.cols(); ++c) blacks.push_back(frame.black_at(r, c));
  const int rows = std::lcm(layout.rows(), frame.layout.rows());
  const int cols = std::lcm(layout.cols(), frame.layout.cols());
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      if (frame.black_at(r, c) != blacks[static_cast<std::size_t>(layout.channel_at(r, c))])
        throw InputError(frame.source,
                         fmt::format("has unlike black levels for the channels of {}, which the "
                                     "channels of {} mix",
                                     frame.layout.name(), layout.name()),
                         "give black: one number, or one per channel in mosaic order");
  return blacks;
}

}  // namespace malus
