// What a report holds: sections of notices, numbers, tables, plots and pictures. Callers fill it,
// write_report makes one HTML file of it. The page's side of the contract is web/src/contract.ts;
// docs/report.md explains both.
#pragma once

#include "malus/base/quantity.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <limits>
#include <optional>
#include <string>
#include <variant>
#include <vector>

namespace malus {

/// A value with its standard error; NaN where there is none.
struct Measured {
  double value = 0;
  double standard_error = kNone;
  static constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
};

struct TextBlock {
  std::vector<std::string> paragraphs;
};

enum class NoticeLevel { kGood, kNote, kWarning };
struct NoticesBlock {
  struct Item {
    NoticeLevel level = NoticeLevel::kNote;
    std::string text;
  };
  std::vector<Item> items;
};

/// The few numbers that a reader looks for first.
struct FiguresBlock {
  struct Item {
    std::string name, symbol, unit, note;
    Measured value;
  };
  std::vector<Item> items;
};

struct TableBlock {
  using Cell = std::variant<std::string, Measured>;  ///< of an infinite value the page says so
  struct Column {
    std::string name, unit;
  };
  struct Row {
    std::string name;
    std::vector<Cell> cells;  ///< one per column
  };
  std::string title, note;
  std::string head;  ///< what the rows are: "channel"
  std::vector<Column> columns;
  std::vector<Row> rows;
};

enum class AxisScale { kLinear, kLogarithmic, kCategory };
struct Axis {
  std::string name, unit = "1";
  AxisScale scale = AxisScale::kLinear;
  std::vector<std::string> categories = {};  ///< points of a category axis are indices into these
  std::optional<double> low = {}, high = {};
};

enum class Mark { kLine, kDashed, kPoints, kCrosses, kBars };
/// x and y have the same length; values that are not finite leave a gap.
struct PointSeries {
  std::string name;
  Mark mark = Mark::kPoints;
  std::string tone = {};  ///< channel name ("G1_45"): colour and symbol follow it; empty = by order
  std::vector<double> x = {}, y = {};
  std::vector<double> error = {};       ///< standard errors of y, or empty
  std::vector<std::string> notes = {};  ///< one per point, or empty: why it was left out
};

/// Box plot over the chart's x categories, whiskers at the outermost values within 1.5
/// interquartile ranges (Tukey); the values beyond are drawn singly.
struct BoxSeries {
  std::string name;
  std::vector<std::string> tones;            ///< one per category
  std::vector<std::vector<double>> samples;  ///< one list per category
};

enum class Palette { kGrey, kSequential, kDiverging, kCyclic };
/// Cells over the x categories (columns) and y categories (rows, first on top).
struct HeatSeries {
  std::string name, unit = "1";
  std::vector<std::vector<double>> cells;
  double low = 0, high = 1;
  Palette palette = Palette::kSequential;
};

using Series = std::variant<PointSeries, BoxSeries, HeatSeries>;

struct Chart {
  std::string title;
  std::string text;  ///< what it shows, in words: caption and description for screen readers
  Axis x, y;
  std::vector<Series> series;
};

/// One chart, or several that the reader chooses from. Contract: not empty.
struct ChartsBlock {
  struct Variant {
    std::string name;
    Chart chart;
  };
  std::string choice;  ///< what the choice is: "Gain"
  std::vector<Variant> charts;
  bool wide = false;  ///< as wide as the page
};

/// Noise of a channel as variance = slope * signal + offset: pictures are stored in steps that are
/// a part of its standard deviation when the exact values would make the file too large.
struct NoiseLine {
  double slope_dn = 0, offset_dn2 = 1;
};

struct ReportPicture {
  std::string name;  ///< "before"
  Image dn;          ///< mosaic, DN above black
  /// What is left of the noise's standard deviation, 1 for a raw frame: it rules how finely the
  /// picture is stored.
  double noise_part = 1;
};

/// A map beside the pictures, at mosaic or cell resolution: confidence, fixed pattern.
struct Layer {
  std::string name, unit = "1", text;
  Palette palette = Palette::kSequential;
  double low = 0, high = 1;
  std::vector<Image> maps;  ///< one per picture, empty where a picture has none; NaN = undefined
};

/// The viewer: pictures of one scene, compared.
struct PicturesBlock {
  std::string title, text;
  SensorLayout layout;
  int rows = 0, cols = 0;  ///< of the mosaic
  std::vector<ReportPicture> pictures = {};
  std::vector<Layer> layers = {};
  std::vector<double> gain_dn_per_e = {};  ///< one per channel, or empty: no read-out in electrons
  std::vector<NoiseLine> noise = {};       ///< one per channel, or empty: not known
  double white_dn = 4095;                  ///< saturation above black
};

using Block =
    std::variant<TextBlock, NoticesBlock, FiguresBlock, TableBlock, ChartsBlock, PicturesBlock>;

struct Section {
  std::string id;  ///< letters, digits and '-', unlike any other section's
  std::string title, lead;
  std::vector<Block> blocks;
};

struct Report {
  std::string title, subtitle;
  std::string program = "malus";
  std::vector<Section> sections;
};

/// A table of quantities with one value per channel: a row per channel, a column per quantity.
TableBlock channel_table(std::string title, const SensorLayout& layout,
                         const std::vector<Quantity>& quantities);

/// Closed curve at `deviations` standard deviations of a two-dimensional Gaussian with the given
/// means, variances and covariance (000 Fig. 4). A covariance beyond the variances' reach is taken
/// as full correlation.
PointSeries gaussian_ellipse(std::string name, double mean_x, double mean_y, double variance_x,
                             double variance_y, double covariance, double deviations);

}  // namespace malus
