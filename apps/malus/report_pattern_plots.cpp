#include "malus/base/statistics.h"
#include "malus/noise/data_sheet.h"

#include <algorithm>
#include <cmath>

#include "report_plots.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

PointSeries line_series(const std::string& name, const std::vector<double>& values, double step) {
  PointSeries series{.name = name, .mark = Mark::kLine};
  for (std::size_t i = 0; i < values.size(); ++i) {
    series.x.push_back(static_cast<double>(i) * step);
    series.y.push_back(values[i]);
  }
  return series;
}

Chart profile_chart(const PhysicsCalibration& p) {
  Chart chart{
      title_at("Profiles of the dark frames", p.gain),
      "Mean of every mosaic row and column of the averaged bias frames, each channel's mean "
      "taken off.",
      {"row or column", "px"},
      {"offset", "DN"},
      {}};
  chart.series = {line_series("rows", row_profile(p.dark_shading_dn), 1),
                  line_series("columns", column_profile(p.dark_shading_dn), 1)};
  return chart;
}

// temporal: what else is in the map than the pattern, said behind the text.
Chart spectrum_chart(const Image& map, const std::string& what, const std::string& unit,
                     const std::string& temporal, const GainSetting& gain) {
  Chart chart{
      title_at("Spectrogram of " + what, gain),
      "EMVA 1288 spectrogram: amplitude against spatial frequency, averaged over the rows "
      "and over the columns. Pixels that differ at random give a level line, stripes a peak. " +
          temporal,
      {"frequency", "periods/px"},
      {"amplitude", unit, AxisScale::kLogarithmic},
      {}};
  chart.series = {line_series("along rows", row_spectrum(map), 1.0 / map.cols()),
                  line_series("along columns", column_spectrum(map), 1.0 / map.rows())};
  return chart;
}

// A range that shows the pattern and not its hottest pixels.
double robust_reach(const Image& map, double middle) {
  std::vector<double> sample;
  const std::size_t stride = std::max<std::size_t>(1, map.size() / 50'000);
  for (std::size_t i = 0; i < map.size(); i += stride)
    sample.push_back(static_cast<double>(map.values()[i]) - middle);
  return std::max(4 * robust_deviation_of(sample), 1e-6);
}

void add_layer(PicturesBlock& maps, const Image& map, const std::string& name,
               const std::string& unit, double middle) {
  if (map.empty() || (maps.rows != 0 && (map.rows() != maps.rows || map.cols() != maps.cols)))
    return;
  maps.rows = map.rows();
  maps.cols = map.cols();
  const double reach = robust_reach(map, middle);
  maps.layers.push_back({.name = name,
                         .unit = unit,
                         .text = {},
                         .palette = Palette::kDiverging,
                         .low = middle - reach,
                         .high = middle + reach,
                         .maps = {map}});
}

// Levels spread over the range: all would be too many to tell apart.
std::vector<std::size_t> some_levels(std::size_t count) {
  constexpr std::size_t kShown = 6;
  std::vector<std::size_t> chosen;
  for (std::size_t i = 0; i < std::min(count, kShown); ++i)
    chosen.push_back(count <= kShown ? i : i * (count - 1) / (kShown - 1));
  return chosen;
}

Chart level_chart(const NonparametricCalibration& n, const NonparametricChannel& channel,
                  const std::string& name) {
  Chart chart{title_at("Noise per level of " + name, n.gain),
              fmt::format("Probability density of noisy minus clean at some of the {} levels.",
                          channel.level_dn.size()),
              {"noise", "DN"},
              {"density", "1/DN", AxisScale::kLogarithmic},
              {}};
  for (const std::size_t level : some_levels(channel.level_dn.size())) {
    PointSeries series{.name = fmt::format("{:.4g} DN", channel.level_dn[level]),
                       .mark = Mark::kLine};
    // Less than a tenth of one sample is what is left of taking the row noise out: not shown.
    const double samples =
        level < channel.samples.size() ? static_cast<double>(channel.samples[level]) : 0.0;
    const double least = samples > 0 ? 0.1 / samples : 0;
    const std::vector<double>& pmf = channel.pmf[level];
    const auto shown = [&](double p) { return p > least; };
    const auto first = std::find_if(pmf.begin(), pmf.end(), shown) - pmf.begin();
    const auto last = pmf.rend() - std::find_if(pmf.rbegin(), pmf.rend(), shown);
    for (auto bin = static_cast<std::size_t>(first); bin < static_cast<std::size_t>(last); ++bin) {
      const double low = channel.bin_edges_dn[bin], high = channel.bin_edges_dn[bin + 1];
      series.x.push_back(0.5 * (low + high));
      series.y.push_back(shown(pmf[bin]) ? pmf[bin] / (high - low) : Measured::kNone);
    }
    chart.series.emplace_back(std::move(series));
  }
  return chart;
}

}  // namespace

std::vector<Block> pattern_plots(const NoiseModel& model) {
  Variants profiles, dark, response;
  PicturesBlock maps{.title = "Maps of the fixed pattern",
                     .text =
                         "Dark shading: mean of the bias frames, each channel's mean taken off. "
                         "Response: relative, from the flat frames.",
                     .layout = SensorLayout()};
  for (const PhysicsCalibration& p : model.physics) {
    if (!p.dark_shading_dn.empty()) {
      profiles.push_back({p.gain.text(), profile_chart(p)});
      dark.push_back(
          {p.gain.text(),
           spectrum_chart(p.dark_shading_dn, "the dark pattern", "DN",
                          fmt::format("What is left of the temporal noise of {} bias frames is in "
                                      "it too, which the data sheet's DSNU is without.",
                                      p.bias_frames),
                          p.gain)});
    }
    if (!p.prnu_map.empty()) {
      Image deviation = p.prnu_map;  // the mean would hide everything at frequency 0
      for (float& value : deviation.values()) value = 100 * (value - 1);
      response.push_back(
          {p.gain.text(),
           spectrum_chart(deviation, "the response", "%",
                          "What is left of the flat frames' temporal noise is in it too.",
                          p.gain)});
    }
    add_layer(maps, p.dark_shading_dn, title_at("dark shading", p.gain), "DN", 0);
    add_layer(maps, p.prnu_map, title_at("response", p.gain), "1", 1);
  }
  std::vector<Block> blocks;
  for (Variants* variants : {&profiles, &dark, &response})
    if (!variants->empty()) blocks.emplace_back(ChartsBlock{"Gain", std::move(*variants)});
  if (!maps.layers.empty()) blocks.emplace_back(std::move(maps));
  return blocks;
}

std::vector<Block> level_plots(const NoiseModel& model) {
  Variants variants;
  for (const NonparametricCalibration& n : model.nonparametric)
    for (int channel = 0; channel < model.layout.channels(); ++channel) {
      const std::string name = model.layout.channel_name(channel);
      variants.push_back({fmt::format("{}, {}", n.gain.text(), name),
                          level_chart(n, n.channels[static_cast<std::size_t>(channel)], name)});
    }
  std::vector<Block> blocks;
  if (!variants.empty())
    blocks.emplace_back(ChartsBlock{"Gain and channel", std::move(variants), true});
  return blocks;
}

}  // namespace malus::app
