#include "malus/calibrate/internal/response_checks.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/calibrate/internal/light_profile.h"
#include "malus/calibrate/internal/line_means.h"
#include "malus/calibrate/internal/pixel_location.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kPeriod = 4;  // the largest cell of pixels
constexpr std::size_t kClasses = kPeriod * kPeriod;

struct ColorLight {
  Color color;
  double light = 0;  ///< mean over the levels, relative to the mean of all colours
};

std::vector<ColorLight> light_of_colors(const SensorLayout& layout,
                                        const std::vector<std::vector<double>>& light_dn) {
  std::vector<ColorLight> out;
  for (const Color color : layout.colors()) {
    Moments light;
    for (const std::vector<double>& level : light_dn)
      for (int c = 0; c < layout.channels(); ++c)
        if (layout.site(c).color == color) light.add(level[as_index(c)] / mean_of(level));
    out.push_back({color, light.mean()});
  }
  return out;
}

// Means of the classes of ordinary pixels whose place in the channel is the same modulo kPeriod.
struct Classes {
  std::array<double, kClasses> mean{};
  std::array<double, kClasses> pixels{};
  double variance = 0;  ///< of the map, about 1
  /// Of the means of rows, and of columns, about those of their classes, without what pixels make
  /// of it; and how many there are.
  double row_variance = 0, col_variance = 0, rows = 1, cols = 1;

  static std::size_t at(int r, int c) { return as_index(r % kPeriod * kPeriod + c % kPeriod); }
  // Between the classes of a smaller period; what chance makes is taken off.
  double between(int period) const {
    double sum = 0;
    for (int i = 0; i < period; ++i)
      for (int j = 0; j < period; ++j) {
        double total = 0, count = 0;
        for (int r = i; r < kPeriod; r += period)
          for (int c = j; c < kPeriod; c += period) {
            total += mean[at(r, c)] * pixels[at(r, c)];
            count += pixels[at(r, c)];
          }
        if (count > 0) sum += std::pow(total / count - 1.0, 2) - variance / count;
      }
    return sum / (period * period) - of_rows(period) - of_cols(period);
  }
  // Variance of that where nothing repeats: means of white noise, and of few rows and columns, two
  // or more of which may be read out together.
  double error2_between(int period) const {
    double all = 0;
    for (const double count : pixels) all += count;
    const double classes = period * period, of_mean = all > 0 ? variance * classes / all : 0.0;
    return 2.0 * (of_mean * of_mean / classes + of_rows(period) * of_rows(period) +
                  of_cols(period) * of_cols(period));
  }
  double of_rows(int period) const { return row_variance * period / rows; }
  double of_cols(int period) const { return col_variance * period / cols; }
};

// Sets what whole rows and columns of the map have in common.
void note_lines(const Image& map, const MosaicGeometry& geometry, int channel, double bound,
                double centre, Classes& out) {
  LineMeans rows(geometry.channel_rows(channel)), cols(geometry.channel_cols(channel));
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    if (std::abs(map(row, col) - centre) > bound) return;
    const double rest = map(row, col) - out.mean[Classes::at(r, c)];
    rows.add(r, rest);
    cols.add(c, rest);
  });
  // The classes' own means take a part of few lines' variance.
  const auto variance = [&](const LineMeans& lines) {
    return lines.variance(out.variance) * lines.lines() / std::max(lines.lines() - kPeriod, 1);
  };
  out.rows = rows.lines();
  out.cols = cols.lines();
  out.row_variance = variance(rows);
  out.col_variance = variance(cols);
}

Classes classes_of(const Image& map, const MosaicGeometry& geometry, int channel) {
  Classes out;
  Moments square;
  const PixelLocation usual =
      location_of(geometry, channel, [&](int row, int col) { return map(row, col); });
  const double bound = kDefectDeviations * usual.deviation;
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    if (std::abs(map(row, col) - usual.centre) > bound) return;
    out.mean[Classes::at(r, c)] += map(row, col);
    out.pixels[Classes::at(r, c)] += 1;
    square.add(std::pow(double{map(row, col)} - 1.0, 2));
  });
  for (std::size_t i = 0; i < kClasses; ++i)
    if (out.pixels[i] > 0) out.mean[i] /= out.pixels[i];
  out.variance = square.mean();
  note_lines(map, geometry, channel, bound, usual.centre, out);
  return out;
}

// Products of next pixels of a channel, without the means of classes, rows and columns (gains of
// their own are no picture); far ones are cut, for a defect is none either, and those without light
// are left out: masked lines lie side by side.
void add_products(const Image& map, const MosaicGeometry& geometry, int channel,
                  const Classes& classes, Moments& products) {
  const double rest = std::max(classes.variance - classes.between(kPeriod), 0.0);
  const double most = 4.0 * std::sqrt(rest);
  const int down = geometry.cell_rows(), right = geometry.cell_cols();
  const auto value = [&](int r, int c, int row, int col) {
    if (map(row, col) < kUnlitShare) return 0.0;
    return std::clamp(map(row, col) - classes.mean[Classes::at(r, c)], -most, most);
  };
  LineMeans rows(geometry.channel_rows(channel)), cols(geometry.channel_cols(channel));
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    rows.add(r, value(r, c, row, col));
    cols.add(c, value(r, c, row, col));
  });
  const auto rest_of = [&](int r, int c, int row, int col) {
    return value(r, c, row, col) - rows.mean(r) - cols.mean(c);
  };
  for_channel(geometry, channel, [&](int r, int c, int row, int col) {
    const double own = rest_of(r, c, row, col);
    if (row + down < map.rows()) products.add(own * rest_of(r + 1, c, row + down, col));
    if (col + right < map.cols()) products.add(own * rest_of(r, c + 1, row, col + right));
  });
}

}  // namespace

void warn_of_colors(const SensorLayout& layout, const std::vector<std::vector<double>>& light_dn,
                    PhysicsCalibration& out) {
  constexpr std::size_t kFewest = 3;
  constexpr double kAlike = 0.003, kGreens = 0.03, kOfOthers = 3.0;
  if (!layout.colored() || light_dn.size() < kFewest) return;
  const std::vector<ColorLight> colors = light_of_colors(layout, light_dn);
  const auto dimmer = [](const ColorLight& a, const ColorLight& b) { return a.light < b.light; };
  const auto [low, high] = std::minmax_element(colors.begin(), colors.end(), dimmer);
  if (high->light - low->light < kAlike) {
    out.warnings.push_back(fmt::format(
        "all colours of {} see the same light, to {:.2g} %: has the sensor colour filters? One "
        "without needs the layout mono or polar-mono",
        layout.name(), 100 * (high->light - low->light)));
    return;
  }
  const auto of = [&](Color color) {
    return std::find_if(colors.begin(), colors.end(),
                        [=](const ColorLight& one) { return one.color == color; });
  };
  const auto first = of(Color::kGreen1), second = of(Color::kGreen2), red = of(Color::kRed),
             blue = of(Color::kBlue);
  for (const auto& color : {first, second, red, blue})
    if (color == colors.end()) return;
  const double greens = std::abs(first->light - second->light),
               others = std::abs(red->light - blue->light);
  if (greens > kGreens && greens > kOfOthers * others)
    out.warnings.push_back(fmt::format(
        "the two greens of {} differ by {:.0f} % of the light, red and blue by less than a third "
        "of that: is it another order of the colours?",
        layout.name(), 100 * greens));
}

void warn_of_angles(const SensorLayout& layout, const std::vector<std::vector<double>>& light_dn,
                    PhysicsCalibration& out) {
  constexpr std::size_t kFewest = 3;
  constexpr double kLeast = 0.05, kOfOthers = 2.0;
  if (!layout.polarized() || light_dn.size() < kFewest) return;
  // The angle that makes a pair with 0, and how much more light that pair sees than the others.
  struct Pairing {
    int partner;
    Moments excess;
  };
  std::array<Pairing, 3> pairings{{{90, {}}, {45, {}}, {135, {}}}};
  for (const std::vector<double>& level : light_dn)
    for (const Color color : layout.colors()) {
      const auto light = [&](int angle) { return level[as_index(layout.find(color, angle))]; };
      const double all = light(0) + light(45) + light(90) + light(135);
      for (Pairing& pairing : pairings)
        pairing.excess.add((light(0) + light(pairing.partner)) / (0.5 * all) - 1.0);
    }
  const double crossed = std::abs(pairings[0].excess.mean());
  const auto& nearer = std::abs(pairings[1].excess.mean()) < std::abs(pairings[2].excess.mean())
                           ? pairings[1]
                           : pairings[2];
  if (crossed > kLeast && crossed > kOfOthers * std::abs(nearer.excess.mean()))
    out.warnings.push_back(fmt::format(
        "0 and 90 degrees of {} see {:.2g} % {} light than 45 and 135, 0 and {} but {:.2g} % {} "
        "than the others: crossed polarizers see the same, so are their places right? `malus info` "
        "of a picture tells, too",
        layout.name(), 100 * crossed, pairings[0].excess.mean() > 0 ? "more" : "less",
        nearer.partner, 100 * std::abs(nearer.excess.mean()),
        nearer.excess.mean() > 0 ? "more" : "less"));
}

ResponsePattern response_pattern(const Response& response, const MosaicGeometry& geometry) {
  constexpr double kSame = 0.9;
  ResponsePattern out;
  double two = 0, four = 0, error2_of_two = 0, error2_of_four = 0;
  const double channels = geometry.channels();
  Moments products;
  for (int c = 0; c < geometry.channels(); ++c) {
    const Classes classes = classes_of(response.map, geometry, c);
    two += classes.between(2) / channels;
    four += classes.between(kPeriod) / channels;
    error2_of_two += classes.error2_between(2) / (channels * channels);
    error2_of_four += classes.error2_between(kPeriod) / (channels * channels);
    out.variance += response.prnu[as_index(c)] * response.prnu[as_index(c)] / channels;
    add_products(response.map, geometry, c, classes, products);
  }
  out.period = two > kSame * four ? 2 : kPeriod;
  out.periodic = std::max(two, four);
  out.periodic_stderr = std::sqrt(two > four ? error2_of_two : error2_of_four);
  out.neighbours = products.mean();
  out.neighbours_stderr = std::sqrt(products.variance() / static_cast<double>(products.count()));
  return out;
}

void warn_of_response(const ResponsePattern& pattern, const SensorLayout& layout,
                      PhysicsCalibration& out) {
  constexpr double kPeriodic = 0.25, kLeast = 0.003, kAlike = 0.1, kErrors = 8.0;
  const double rest = pattern.variance - pattern.periodic;
  if (pattern.periodic >
      std::max({kPeriodic * pattern.variance, kLeast * kLeast, kErrors * pattern.periodic_stderr}))
    out.warnings.push_back(fmt::format(
        "of a PRNU of {:.3g} %, {:.3g} % repeat every {} rows or columns of a channel: is the "
        "layout {} right? Pixels of one channel have one colour and one polarizer (columns with "
        "gains of their own show so, too)",
        100 * std::sqrt(pattern.variance), 100 * std::sqrt(pattern.periodic), pattern.period,
        layout.name()));
  else if (pattern.neighbours > std::max(kAlike * rest, kErrors * pattern.neighbours_stderr))
    out.warnings.push_back(
        fmt::format("the response of neighbouring pixels is alike, {:.2g} of its square of {:.3g} "
                    "%: PRNU holds a "
                    "picture of the lit surface, or dust; defocus, or use a diffuser",
                    pattern.neighbours / rest, 100 * std::sqrt(pattern.variance)));
}

void warn_of_unlit_lines(const UnlitLines& unlit, PhysicsCalibration& out) {
  const auto text = [](const std::vector<int>& lines, const char* what) {
    return fmt::format("{} {}{} (the first is {})", lines.size(), what, lines.size() > 1 ? "s" : "",
                       lines.front());
  };
  std::vector<std::string> parts;
  if (!unlit.rows.empty()) parts.push_back(text(unlit.rows, "row"));
  if (!unlit.cols.empty()) parts.push_back(text(unlit.cols, "column"));
  if (parts.empty()) return;
  out.warnings.push_back(fmt::format(
      "{} see no light in the flats, numbered from 0: masked by the sensor (optical black), or "
      "lost? They count as defects; crop all frames to the lit part",
      joined(parts, " and ")));
}

}  // namespace malus
