// Where values lie on the paper: axes with their ticks.
#pragma once

#include "malus/report/internal/colors.h"
#include "malus/report/report.h"

#include <string>
#include <string_view>
#include <vector>

namespace malus::internal {

struct Tick {
  double at = 0;  ///< paper units
  std::string label;
};

/// One axis mapped to [from, to] in paper units (to < from for an upward y axis).
class PlotAxis {
 public:
  /// low and high: the range of the data; widened to round numbers unless the axis fixes it.
  PlotAxis(const Axis& axis, double low, double high, double from, double to);
  double place(double value) const;
  bool shows(double value) const;
  /// Its place, or the nearer end of the axis for what lies beyond.
  double place_within(double value) const;
  /// Width of a category, or of a hundredth of the axis.
  double category_width() const;
  const std::vector<Tick>& ticks() const { return ticks_; }
  double from() const { return from_; }
  double to() const { return to_; }

 private:
  void widen_if_narrow();
  void linear_ticks();
  void logarithmic_ticks();

  bool logarithmic_ = false;
  std::size_t categories_ = 0;
  double low_ = 0, high_ = 1, from_ = 0, to_ = 1;
  std::vector<Tick> ticks_;
};

/// The two axes of a chart on the paper.
struct PlotArea {
  PlotAxis x, y;
};

/// Range of the finite values of a chart along one axis (positive ones only on a logarithmic axis).
struct Range {
  double low, high;
};
Range range_of(const Chart& chart, bool horizontal);

/// The marks of one series as SVG elements; order gives the colour where no tone does.
std::string series_svg(const Series& series, std::size_t order, const PlotArea& area);

/// A mark as the key shows it, its middle at x and y.
std::string key_mark_svg(Mark mark, const Tone& tone, double x, double y);

std::string xml_safe(std::string_view text);

}  // namespace malus::internal
