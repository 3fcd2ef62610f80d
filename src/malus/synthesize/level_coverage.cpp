#include "malus/synthesize/level_coverage.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"

#include <algorithm>
#include <atomic>

#include <fmt/format.h>

namespace malus {
namespace {

std::string share_text(std::int64_t part, std::int64_t all) {
  return fmt::format("{:.3g} % of the pixels",
                     100.0 * static_cast<double>(part) / static_cast<double>(all));
}

LevelRange common_range(const std::vector<LevelRange>& ranges) {
  LevelRange common = ranges.front();
  for (const LevelRange& range : ranges) common = common_ranges({common}, {range}).front();
  return common;
}

}  // namespace

void LevelCoverage::add(const LevelCoverage& other) {
  if (other.pixels == 0) return;
  range = pixels == 0 ? other.range : common_range({range, other.range});
  pixels += other.pixels;
  below += other.below;
  above += other.above;
}

std::string LevelCoverage::complaint() const {
  std::string text;
  if (above > 0)
    text = fmt::format(
        "{} lie above the brightest level of the non-parametric model ({:.4g} DN): {}",
        share_text(above, pixels), range.brightest_dn,
        range.continued ? "they get its noise, widened as shot noise grows"
                        : "they get its noise, which is too weak there; calibrate it with "
                          "brighter frames, or with flats beside them");
  if (below > 0)
    text += fmt::format("{}{} lie below its darkest level ({:.4g} DN){}", text.empty() ? "" : "; ",
                        share_text(below, pixels), range.darkest_dn,
                        ": they get its noise, which is too strong there; calibrate it with bias "
                        "frames");
  return text;
}

LevelCoverage level_coverage(const SensorLayout& layout, const std::vector<LevelRange>& ranges,
                             View<const float> signal_dn, int row0, int col0) {
  MALUS_REQUIRE(static_cast<int>(ranges.size()) == layout.channels());
  std::atomic<std::int64_t> pixels = 0, below = 0, above = 0;
  const int period = layout.cols();
  constexpr std::ptrdiff_t kRowsPerPiece = 32;
  parallel_for(0, signal_dn.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    std::int64_t finite = 0, darker = 0, brighter = 0;
    for (int r = static_cast<int>(begin); r < end; ++r)
      for (int phase = 0; phase < std::min(period, signal_dn.cols()); ++phase) {
        const LevelRange& range =
            ranges[static_cast<std::size_t>(layout.channel_at(row0 + r, col0 + phase))];
        const auto low = static_cast<float>(range.darkest_dn);
        const auto high = static_cast<float>(range.brightest_dn);
        const float* row = signal_dn.row(r);
        for (int c = phase; c < signal_dn.cols(); c += period) {
          const float signal = row[c];
          const bool is_finite = signal - signal == 0.0f;
          finite += is_finite;
          darker += is_finite & (std::max(signal, 0.0f) < low);
          brighter += is_finite & (signal > high);
        }
      }
    pixels += finite;
    below += darker;
    above += brighter;
  });
  return {pixels, below, above, common_range(ranges)};
}

}  // namespace malus
