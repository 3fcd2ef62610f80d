#include "malus/base/error.h"
#include "malus/report/internal/json.h"
#include "malus/report/report.h"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace malus {
namespace {

Measured measured_of(const Quantity& quantity, std::size_t channel) {
  if (channel >= quantity.value.size()) return {Measured::kNone, Measured::kNone};
  const bool known = channel < quantity.standard_error.size();
  return {quantity.value[channel], known ? quantity.standard_error[channel] : Measured::kNone};
}

// Linear interpolation between order statistics (Hyndman and Fan 1996, definition 7).
double quantile_of(const std::vector<double>& sorted, double part) {
  const double at = part * static_cast<double>(sorted.size() - 1);
  const auto below = static_cast<std::size_t>(at);
  const std::size_t above = std::min(below + 1, sorted.size() - 1);
  return sorted[below] + (at - static_cast<double>(below)) * (sorted[above] - sorted[below]);
}

}  // namespace

TableBlock channel_table(std::string title, const SensorLayout& layout,
                         const std::vector<Quantity>& quantities) {
  TableBlock table{
      .title = std::move(title), .note = {}, .head = "channel", .columns = {}, .rows = {}};
  for (const Quantity& quantity : quantities)
    table.columns.push_back(
        {quantity.symbol.empty() ? quantity.description : quantity.symbol, quantity.unit});
  for (int channel = 0; channel < layout.channels(); ++channel) {
    TableBlock::Row row{layout.channel_name(channel), {}};
    for (const Quantity& quantity : quantities)
      row.cells.emplace_back(measured_of(quantity, static_cast<std::size_t>(channel)));
    table.rows.push_back(std::move(row));
  }
  return table;
}

PointSeries gaussian_ellipse(std::string name, double mean_x, double mean_y, double variance_x,
                             double variance_y, double covariance, double deviations) {
  const double sd_x = std::sqrt(std::max(variance_x, 0.0));
  const double sd_y = std::sqrt(std::max(variance_y, 0.0));
  const double reach = sd_x * sd_y;
  const double correlation = reach > 0 ? std::clamp(covariance / reach, -1.0, 1.0) : 0.0;
  PointSeries curve{.name = std::move(name), .mark = Mark::kLine};
  // The Cholesky factor of the covariance turns the unit circle into the ellipse.
  constexpr int kPoints = 90;
  for (int i = 0; i <= kPoints; ++i) {
    const double angle = 2 * std::numbers::pi * i / kPoints;
    const double u = deviations * std::cos(angle), v = deviations * std::sin(angle);
    curve.x.push_back(mean_x + sd_x * u);
    curve.y.push_back(mean_y +
                      sd_y * (correlation * u + std::sqrt(1 - correlation * correlation) * v));
  }
  return curve;
}

namespace internal {

Box box_of(std::vector<double> sample) {
  std::erase_if(sample, [](double value) { return !std::isfinite(value); });
  MALUS_REQUIRE(!sample.empty());
  std::sort(sample.begin(), sample.end());
  Box box;
  for (int part = 1; part <= 3; ++part) box.parts[part] = quantile_of(sample, 0.25 * part);
  const double reach = 1.5 * (box.parts[3] - box.parts[1]);
  box.parts[0] = box.parts[1];
  box.parts[4] = box.parts[3];
  for (const double value : sample) {
    if (value < box.parts[1] - reach || value > box.parts[3] + reach) {
      box.outliers.push_back(value);
      continue;
    }
    box.parts[0] = std::min(box.parts[0], value);
    box.parts[4] = std::max(box.parts[4], value);
  }
  return box;
}

}  // namespace internal
}  // namespace malus
