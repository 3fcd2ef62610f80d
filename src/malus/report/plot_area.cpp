#include "malus/report/internal/plot_area.h"

#include "malus/base/error.h"
#include "malus/report/internal/json.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus::internal {
namespace {

std::string label_of(double value, double step) {
  if (std::abs(value) < 1e-9 * step) return "0";
  return fmt::format("{:.6g}", value);
}

// 1, 2 or 5 times a power of ten, about five to a range.
double round_step(double span) {
  const double raw = span / 5;
  const double power = std::pow(10.0, std::floor(std::log10(raw)));
  const double lead = raw / power;
  return power * (lead < 1.5 ? 1 : lead < 3.5 ? 2 : lead < 7.5 ? 5 : 10);
}

}  // namespace

PlotAxis::PlotAxis(const Axis& axis, double low, double high, double from, double to)
    : logarithmic_(axis.scale == AxisScale::kLogarithmic),
      low_(low),
      high_(high),
      from_(from),
      to_(to) {
  if (axis.scale == AxisScale::kCategory) {
    categories_ = axis.categories.size();
    low_ = -0.5;
    high_ = static_cast<double>(categories_) - 0.5;
    for (std::size_t i = 0; i < categories_; ++i)
      ticks_.push_back({place(static_cast<double>(i)), axis.categories[i]});
    return;
  }
  if (axis.low) low_ = *axis.low;
  if (axis.high) high_ = *axis.high;
  if (logarithmic_) {
    low_ = std::log10(std::max(low_, 1e-300));
    high_ = std::log10(std::max(high_, 1e-300));
  }
  widen_if_narrow();
  if (logarithmic_)
    logarithmic_ticks();
  else
    linear_ticks();
}

// Values that differ by rounding alone are one value: no ticks fit between them.
void PlotAxis::widen_if_narrow() {
  constexpr double kRounding = 1e-12, kLeast = 0.5, kLeastPart = 1e-9;
  const double magnitude = std::max(std::abs(low_), std::abs(high_));
  if (high_ - low_ > kRounding * magnitude) return;
  const double by = std::max(kLeast, kLeastPart * magnitude);
  low_ -= by;
  high_ += by;
}

void PlotAxis::linear_ticks() {
  const double margin = 0.04 * (high_ - low_);
  if (low_ != 0) low_ -= margin;
  high_ += margin;
  const double step = round_step(high_ - low_), first = std::ceil(low_ / step);
  const auto tick = [&](int i) { return (first + i) * step; };
  for (int i = 0; tick(i) <= high_ + 1e-9 * step; ++i)
    ticks_.push_back({place(tick(i)), label_of(tick(i), step)});
}

void PlotAxis::logarithmic_ticks() {
  const double margin = 0.04 * (high_ - low_);
  low_ -= margin;
  high_ += margin;
  const bool few_decades = high_ - low_ < 2;
  for (int decade = static_cast<int>(std::floor(low_)); decade <= high_; ++decade)
    for (const int lead : {1, 2, 5}) {
      const double value = lead * std::pow(10.0, decade);
      if ((lead == 1 || few_decades) && shows(value))
        ticks_.push_back({place(value), fmt::format("{:.6g}", value)});
    }
}

double PlotAxis::place(double value) const {
  const double at = logarithmic_ ? std::log10(value) : value;
  return from_ + (at - low_) / (high_ - low_) * (to_ - from_);
}

bool PlotAxis::shows(double value) const {
  if (!std::isfinite(value) || (logarithmic_ && value <= 0)) return false;
  const double at = logarithmic_ ? std::log10(value) : value;
  const double slack = 1e-9 * (high_ - low_);
  return at >= low_ - slack && at <= high_ + slack;
}

double PlotAxis::place_within(double value) const {
  if (logarithmic_ && value <= 0) return from_;
  return std::clamp(place(value), std::min(from_, to_), std::max(from_, to_));
}

double PlotAxis::category_width() const {
  const double pieces = categories_ > 0 ? static_cast<double>(categories_) : 100;
  return std::abs(to_ - from_) / pieces;
}

Range range_of(const Chart& chart, bool horizontal) {
  Range range{std::numeric_limits<double>::infinity(), -std::numeric_limits<double>::infinity()};
  const bool positive = (horizontal ? chart.x : chart.y).scale == AxisScale::kLogarithmic;
  const auto take = [&](double value) {
    if (!std::isfinite(value) || (positive && value <= 0)) return;
    range.low = std::min(range.low, value);
    range.high = std::max(range.high, value);
  };
  for (const Series& series : chart.series) {
    if (const auto* points = std::get_if<PointSeries>(&series)) {
      const auto& values = horizontal ? points->x : points->y;
      for (std::size_t i = 0; i < values.size(); ++i) {
        take(values[i]);
        if (horizontal || points->error.empty()) continue;
        take(values[i] - points->error[i]);  // an unknown error hides no point
        take(values[i] + points->error[i]);
      }
      if (!horizontal && points->mark == Mark::kBars) take(0);
    } else if (const auto* boxes = std::get_if<BoxSeries>(&series); boxes && !horizontal) {
      for (const auto& sample : boxes->samples)
        for (const double value : sample) take(value);
    }
  }
  if (!(range.low <= range.high)) range = {positive ? 1.0 : 0.0, positive ? 10.0 : 1.0};
  return range;
}

std::string xml_safe(std::string_view text) {
  std::string safe;
  for (const char character : text) {
    const auto byte = static_cast<unsigned char>(character);
    if (character == '<')
      safe += "&lt;";
    else if (character == '>')
      safe += "&gt;";
    else if (character == '&')
      safe += "&amp;";
    else if (character == '"')
      safe += "&quot;";
    else if (byte >= 0x20)
      safe += character;
  }
  return safe;
}

}  // namespace malus::internal
