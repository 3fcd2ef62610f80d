#include "malus/synthesize/level_sampler.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/synthesize/compiled_kernel.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace malus {
namespace {

// The level at or below the start of the step before each: never above the true one, however the
// signal's own step was rounded.
std::vector<std::uint16_t> level_guesses(const std::vector<float>& level_dn, float start,
                                         float per_dn) {
  std::vector<std::uint16_t> guess;
  std::size_t level = 0;
  for (int g = 0; g <= kGuesses; ++g) {
    const float signal = start + static_cast<float>(g - 1) / per_dn;
    while (level + 2 < level_dn.size() && signal >= level_dn[level + 1]) ++level;
    guess.push_back(static_cast<std::uint16_t>(level));
  }
  return guess;
}

void append_places(const std::vector<double>& edges_dn, std::vector<BinPlace>& places) {
  for (std::size_t b = 0; b + 1 < edges_dn.size(); ++b)
    places.push_back(
        {static_cast<float>(edges_dn[b]), static_cast<float>(edges_dn[b + 1] - edges_dn[b])});
}

}  // namespace

std::vector<AliasCell> alias_cells(const std::vector<double>& probabilities) {
  const double total = std::accumulate(probabilities.begin(), probabilities.end(), 0.0);
  MALUS_REQUIRE(total > 0);
  const std::size_t n = probabilities.size();
  std::vector<double> share(n);
  std::vector<std::size_t> small, large;
  for (std::size_t i = 0; i < n; ++i) {
    share[i] = probabilities[i] / total * static_cast<double>(n);
    (share[i] < 1 ? small : large).push_back(i);
  }
  std::vector<AliasCell> cells(n);
  for (std::size_t i = 0; i < n; ++i) cells[i] = {1u << 24, static_cast<std::uint32_t>(i)};
  while (!small.empty() && !large.empty()) {
    const std::size_t poor = small.back(), rich = large.back();
    small.pop_back();
    cells[poor] = {static_cast<std::uint32_t>(std::lround(share[poor] * 0x1p24)),
                   static_cast<std::uint32_t>(rich)};
    share[rich] -= 1.0 - share[poor];
    if (share[rich] < 1) {
      large.pop_back();
      small.push_back(rich);
    }
  }
  return cells;
}

LevelSampler::LevelSampler(const SensorLayout& layout, const NonparametricCalibration& calibration,
                           int row_group)
    : layout_(layout), row_group_(row_group) {
  MALUS_REQUIRE(static_cast<int>(calibration.channels.size()) == layout.channels());
  channels_.resize(calibration.channels.size());
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    const NonparametricChannel& measured = calibration.channels[c];
    Channel& channel = channels_[c];
    for (const double level : measured.level_dn)
      channel.level_dn.push_back(static_cast<float>(level));
    append_places(measured.bin_edges_dn, channel.places);
    for (const auto& pmf : measured.pmf) {
      const auto cells = alias_cells(pmf);
      channel.alias.insert(channel.alias.end(), cells.begin(), cells.end());
    }
    finish(channel, static_cast<int>(channel.places.size()), true);
    if (!calibration.sigma_row_dn.empty())
      channel.sigma_row_dn = static_cast<float>(calibration.sigma_row_dn[c]);
  }
}

LevelSampler::LevelSampler(const SensorLayout& layout,
                           const std::vector<std::vector<LevelDistribution>>& channels,
                           const std::vector<double>& sigma_row_dn, int row_group)
    : layout_(layout), row_group_(row_group) {
  MALUS_REQUIRE(static_cast<int>(channels.size()) == layout.channels());
  channels_.resize(channels.size());
  for (std::size_t c = 0; c < channels_.size(); ++c) {
    Channel& channel = channels_[c];
    const std::size_t bins = channels[c].front().pmf.size();
    for (const LevelDistribution& level : channels[c]) {
      MALUS_REQUIRE(level.pmf.size() == bins && level.bin_edges_dn.size() == bins + 1);
      channel.level_dn.push_back(static_cast<float>(level.level_dn));
      append_places(level.bin_edges_dn, channel.places);
      const auto cells = alias_cells(level.pmf);
      channel.alias.insert(channel.alias.end(), cells.begin(), cells.end());
    }
    finish(channel, static_cast<int>(bins), false);
    if (!sigma_row_dn.empty()) channel.sigma_row_dn = static_cast<float>(sigma_row_dn[c]);
  }
}

void LevelSampler::finish(Channel& channel, int bins, bool shared_places) {
  const float start = channel.level_dn.front();
  const float range = channel.level_dn.back() - start;
  const float per_dn = range > 0 ? static_cast<float>(kGuesses) / range : 0.0f;
  if (range > 0) channel.guess = level_guesses(channel.level_dn, start, per_dn);
  channel.tables = {.levels = static_cast<int>(channel.level_dn.size()),
                    .bins = bins,
                    .level_dn = channel.level_dn.data(),
                    .alias = channel.alias.data(),
                    .places = channel.places.data(),
                    .places_per_level = shared_places ? 0 : bins,
                    .guess = channel.guess.data(),
                    .guess_start_dn = start,
                    .guesses_per_dn = per_dn};
}

void LevelSampler::apply(View<const float> signal_dn, View<const float> base_dn, View<float> out_dn,
                         const DrawAddress& address) const {
  MALUS_REQUIRE(signal_dn.rows() == out_dn.rows() && signal_dn.cols() == out_dn.cols());
  MALUS_REQUIRE(base_dn.rows() == out_dn.rows() && base_dn.cols() == out_dn.cols());
  MALUS_REQUIRE(address.row0 >= 0 && address.col0 >= 0);
  constexpr std::ptrdiff_t kRowsPerPiece = 8;
  parallel_for(0, out_dn.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r) {
      const int row = address.row0 + r;
      const float z =
          row_group_ > 0 ? static_cast<float>(row_group_draw(address, row, row_group_)) : 0.0f;
      internal::for_each_word_pair(address, row, out_dn.cols(), [&](int c, PixelWords words) {
        const float signal = signal_dn(r, c), base = base_dn(r, c);
        const Channel& channel =
            channels_[static_cast<std::size_t>(layout_.channel_at(row, address.col0 + c))];
        out_dn(r, c) =
            std::isfinite(signal) && std::isfinite(base)
                ? base + level_noise(channel.tables, signal, words) + channel.sigma_row_dn * z
                : base;
      });
    }
  });
}

}  // namespace malus
