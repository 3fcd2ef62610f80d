#include "malus/synthesize/level_sampler.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/noise/level_noise.h"
#include "malus/synthesize/formation.h"
#include "malus/synthesize/internal/level_kernel.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace malus {
namespace {

// The span at or below the start of the step before each: never above the true one, however the
// signal's own step was rounded.
void append_guesses(const std::vector<double>& level_dn, float start, float per_dn,
                    std::vector<std::uint32_t>& guess) {
  std::size_t level = 0;
  for (int g = 0; g <= kGuesses; ++g) {
    const float signal = per_dn > 0 ? start + static_cast<float>(g - 1) / per_dn : start;
    while (level + 2 < level_dn.size() && signal >= static_cast<float>(level_dn[level + 1]))
      ++level;
    guess.push_back(static_cast<std::uint32_t>(level));
  }
}

// Levels above the measured ones, close enough that a mixture of two neighbours is as good as their
// distribution: its excess kurtosis is 3 ((r + 1)² / (4 r) - 1) for variances v and r v.
struct Continuation {
  std::vector<double> level_dn, spread;
};

Continuation continuation(const NonparametricChannel& measured, const LevelMoments& brightest,
                          double gain_dn_per_e, double highest_dn) {
  constexpr double kStep = 1.05;  // from spread to spread: an excess of 0.007
  Continuation above;
  const double last_dn = measured.level_dn.back(), variance = brightest.variance_dn2;
  const double most = spread_above_levels(variance, gain_dn_per_e, highest_dn - last_dn);
  if (!(most > 1)) return above;
  const int steps = static_cast<int>(std::ceil(std::log(most) / std::log(kStep)));
  for (int i = 1; i <= steps; ++i) {
    above.spread.push_back(std::pow(most, static_cast<double>(i) / steps));
    above.level_dn.push_back(last_dn + (above.spread.back() * above.spread.back() - 1) * variance /
                                           gain_dn_per_e);
  }
  return above;
}

// Bin edges `spread` times as wide about the level's mean, then drawn together until the variance
// of rounding, q²/12, is gone.
std::vector<double> edges_of_level(const NonparametricChannel& channel, std::size_t level,
                                   double spread, double rounded_to_dn) {
  std::vector<double> edges = channel.bin_edges_dn;
  if (spread == 1.0 && rounded_to_dn == 0) return edges;
  const LevelMoments moments = level_moments(channel, level);
  if (!(moments.variance_dn2 > 0)) return edges;
  const double rounding = rounded_to_dn * rounded_to_dn / 12.0 / moments.variance_dn2;
  const double factor = std::sqrt(std::max(spread * spread - rounding, 0.0));
  for (double& edge : edges) edge = moments.mean_dn + factor * (edge - moments.mean_dn);
  return edges;
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
                           int row_group, double highest_dn, LevelRounding rounding)
    : layout_(layout), row_group_(row_group), row_drift_(calibration.row_drift.drift) {
  MALUS_REQUIRE(static_cast<int>(calibration.channels.size()) == layout.channels());
  for (std::size_t c = 0; c < calibration.channels.size(); ++c)
    add_calibrated(calibration.channels[c], gain_of_channel(calibration, c),
                   calibration.sigma_row_dn.empty() ? 0.0 : calibration.sigma_row_dn[c], highest_dn,
                   rounding);
}

// The levels that were measured, and above them the brightest one, wider and wider.
void LevelSampler::add_calibrated(const NonparametricChannel& measured, double gain_dn_per_e,
                                  double sigma_row_dn, double highest_dn, LevelRounding rounding) {
  const std::size_t last = measured.pmf.size() - 1;
  const Continuation above =
      continuation(measured, level_moments(measured, last), gain_dn_per_e, highest_dn);
  std::vector<double> level_dn = measured.level_dn;
  level_dn.insert(level_dn.end(), above.level_dn.begin(), above.level_dn.end());
  const bool shared_places = above.level_dn.empty() && !(rounding.step_dn > 0);
  add_channel(level_dn, measured.bin_edges_dn.size() - 1, shared_places, sigma_row_dn);
  if (shared_places) add_places(measured.bin_edges_dn);
  for (std::size_t l = 0; l <= last; ++l) {
    const bool holds_rounding = !before_rounding(measured, l, rounding.step_dn);
    if (!shared_places)
      add_places(edges_of_level(measured, l, 1.0, holds_rounding ? rounding.step_dn : 0.0));
    add_cells(measured.pmf[l]);
  }
  for (const double spread : above.spread) {
    add_places(edges_of_level(measured, last, spread, rounding.step_dn));
    add_cells(measured.pmf.back());
  }
}

LevelSampler::LevelSampler(const SensorLayout& layout,
                           const std::vector<std::vector<LevelDistribution>>& channels,
                           const std::vector<double>& sigma_row_dn, int row_group,
                           const RowDrift& row_drift)
    : layout_(layout), row_group_(row_group), row_drift_(row_drift) {
  MALUS_REQUIRE(static_cast<int>(channels.size()) == layout.channels());
  for (std::size_t c = 0; c < channels.size(); ++c) {
    const std::size_t bins = channels[c].front().pmf.size();
    std::vector<double> level_dn;
    for (const LevelDistribution& level : channels[c]) level_dn.push_back(level.level_dn);
    add_channel(level_dn, bins, false, sigma_row_dn.empty() ? 0.0 : sigma_row_dn[c]);
    for (const LevelDistribution& level : channels[c]) {
      MALUS_REQUIRE(level.pmf.size() == bins && level.bin_edges_dn.size() == bins + 1);
      add_places(level.bin_edges_dn);
      add_cells(level.pmf);
    }
  }
}

void LevelSampler::add_channel(const std::vector<double>& level_dn, std::size_t bins,
                               bool shared_places, double sigma_row_dn) {
  MALUS_REQUIRE(!level_dn.empty());
  Channel channel;
  channel.sigma_row_dn = static_cast<float>(sigma_row_dn);
  channel.guess_start_dn = static_cast<float>(level_dn.front());
  const float range = static_cast<float>(level_dn.back()) - channel.guess_start_dn;
  if (range > 0) channel.guesses_per_dn = static_cast<float>(kGuesses) / range;
  const auto place = [](const auto& table) { return static_cast<std::uint32_t>(table.size()); };
  channel.first_guess = place(guess_);
  channel.first_span = place(spans_);
  channel.last_span = static_cast<std::uint32_t>(std::max<std::size_t>(level_dn.size(), 2) - 2);
  channel.bins = static_cast<std::uint32_t>(bins);
  channel.first_cell = place(cells_);
  channel.first_place = place(places_);
  channel.places_per_level = shared_places ? 0 : channel.bins;
  channels_.push_back(channel);
  append_guesses(level_dn, channel.guess_start_dn, channel.guesses_per_dn, guess_);
  for (std::size_t l = 0; l + 1 < level_dn.size(); ++l)
    spans_.push_back({static_cast<float>(level_dn[l]), static_cast<float>(level_dn[l + 1])});
  if (level_dn.size() == 1)
    spans_.push_back({channel.guess_start_dn, std::numeric_limits<float>::infinity()});
}

void LevelSampler::add_places(const std::vector<double>& edges_dn) {
  for (std::size_t b = 0; b + 1 < edges_dn.size(); ++b)
    places_.push_back(
        {static_cast<float>(edges_dn[b]), static_cast<float>(edges_dn[b + 1] - edges_dn[b])});
}

void LevelSampler::add_cells(const std::vector<double>& pmf) {
  const auto cells = alias_cells(pmf);
  cells_.insert(cells_.end(), cells.begin(), cells.end());
}

// The rows of one phase of the cell: channel numbers repeated along the row.
struct LevelSampler::RowLanes {
  std::vector<float> guess_start_dn, guesses_per_dn, sigma_row_dn;
  std::vector<std::uint32_t> first_guess, first_span, last_span, bins, first_cell, first_place,
      places_per_level;

  void add(const Channel& channel) {
    guess_start_dn.push_back(channel.guess_start_dn);
    guesses_per_dn.push_back(channel.guesses_per_dn);
    sigma_row_dn.push_back(channel.sigma_row_dn);
    first_guess.push_back(channel.first_guess);
    first_span.push_back(channel.first_span);
    last_span.push_back(channel.last_span);
    bins.push_back(channel.bins);
    first_cell.push_back(channel.first_cell);
    first_place.push_back(channel.first_place);
    places_per_level.push_back(channel.places_per_level);
  }
  internal::LevelRowLanes view(const float* offset_dn) const {
    return {static_cast<int>(bins.size()),
            guess_start_dn.data(),
            guesses_per_dn.data(),
            offset_dn,
            first_guess.data(),
            first_span.data(),
            last_span.data(),
            bins.data(),
            first_cell.data(),
            first_place.data(),
            places_per_level.data()};
  }
};

std::vector<LevelSampler::RowLanes> LevelSampler::row_lanes() const {
  const int period = std::lcm(layout_.cols(), kGroupColumns);
  std::vector<RowLanes> phases(static_cast<std::size_t>(layout_.rows()));
  for (int phase = 0; phase < layout_.rows(); ++phase)
    for (int c = 0; c < period; ++c)
      phases[static_cast<std::size_t>(phase)].add(
          channels_[static_cast<std::size_t>(layout_.channel_at(phase, c))]);
  return phases;
}

void LevelSampler::apply(View<const float> signal_dn, View<const float> base_dn, View<float> out_dn,
                         const DrawAddress& address) const {
  MALUS_REQUIRE(signal_dn.rows() == out_dn.rows() && signal_dn.cols() == out_dn.cols());
  MALUS_REQUIRE(base_dn.rows() == out_dn.rows() && base_dn.cols() == out_dn.cols());
  require_place(address, out_dn.rows(), out_dn.cols());
  const auto phases = row_lanes();
  internal::LevelRowJob job;
  job.tables = {guess_.data(), spans_.data(), cells_.data(), places_.data()};
  job.seed = address.seed;
  job.frame = address.frame;
  job.col0 = address.col0;
  job.cols = out_dn.cols();
  std::vector<double> deviates(static_cast<std::size_t>(out_dn.rows()), 0.0);
  if (row_group_ > 0) deviates = row_deviates(address, out_dn.rows(), row_group_, row_drift_);
  constexpr std::ptrdiff_t kRowsPerPiece = 8;
  parallel_for(0, out_dn.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    internal::LevelRowJob mine = job;
    std::vector<float> offset_dn;
    for (int r = static_cast<int>(begin); r < end; ++r) {
      mine.row = address.row0 + r;
      const RowLanes& lanes = phases[static_cast<std::size_t>(mine.row % layout_.rows())];
      const auto z = static_cast<float>(deviates[static_cast<std::size_t>(r)]);
      offset_dn.clear();
      for (const float sigma : lanes.sigma_row_dn) offset_dn.push_back(sigma * z);
      mine.lanes = lanes.view(offset_dn.data());
      mine.signal_dn = signal_dn.row(r);
      mine.base_dn = base_dn.row(r);
      mine.out_dn = out_dn.row(r);
      internal::run_level_row(mine);
    }
  });
}

}  // namespace malus
