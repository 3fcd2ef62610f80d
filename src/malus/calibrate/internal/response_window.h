// The surroundings that a pixel's response is relative to, and what their mean takes of it.
#pragma once

#include "malus/base/index.h"
#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/light_polynomial.h"
#include "malus/image/view.h"
#include "malus/noise/row_drift.h"

#include <algorithm>
#include <cstdlib>
#include <numeric>
#include <vector>

namespace malus {

inline constexpr int kLargestRadius = 7;

// A small plane needs a small window, or the curve of the light shows in it.
inline int largest_radius(const MosaicGeometry& geometry, int channel) {
  return std::clamp(std::min(geometry.channel_rows(channel), geometry.channel_cols(channel)) / 8, 1,
                    kLargestRadius);
}

// Windows shrink towards a border so that they stay centred: a slope in the light then cancels.
inline int window_radius(int at, int length, int largest) {
  return std::min({at, length - 1 - at, largest});
}

inline double window_width(int at, int length, int largest) {
  return 2.0 * window_radius(at, length, largest) + 1.0;
}

// What is left of white noise when the mean of a window of n pixels, its own among them, is taken
// off: 1 - 1/n. 0 in corners.
inline double kept_variance(int r, int c, const MosaicGeometry& geometry, int channel) {
  const int largest = largest_radius(geometry, channel);
  return 1.0 - 1.0 / (window_width(r, geometry.channel_rows(channel), largest) *
                      window_width(c, geometry.channel_cols(channel), largest));
}

// The same of what whole lines (rows or columns) have in common, of which a window of w lines holds
// its own w-th part.
inline double kept_of_line(int at, int length, int largest) {
  return 1.0 - 1.0 / window_width(at, length, largest);
}

// The same of row noise: rows that are read out together, or drift slowly, are alike, and a window
// takes more of their noise.
inline double kept_of_row_noise(int at, const MosaicGeometry& geometry, int channel,
                                const RowDrift& drift) {
  const int radius =
      window_radius(at, geometry.channel_rows(channel), largest_radius(geometry, channel));
  const auto group = [&](int row) {
    return (channel / geometry.cell_cols() + row * geometry.cell_rows()) / geometry.row_group();
  };
  const auto alike = [&](int a, int b) {
    return row_autocorrelation(drift, std::abs(group(a) - group(b)));
  };
  double own = 0, all = 0;
  for (int a = at - radius; a <= at + radius; ++a) {
    own += alike(at, a);
    for (int b = at - radius; b <= at + radius; ++b) all += alike(a, b);
  }
  const double rows = 2.0 * radius + 1.0;
  return 1.0 - 2.0 * own / rows + all / (rows * rows);
}

// Of what a window's mean leaves, the share that the light's polynomial before it leaves of white
// noise, and of what whole lines have in common.
struct KeptByLight {
  double of_pixels = 1, of_rows = 1, of_cols = 1;
};

// Along one direction: products of polynomials with their windows' means, and of these with
// themselves.
struct PolynomialMeans {
  std::vector<double> with_means, of_means;
};
inline PolynomialMeans means_in_windows(const std::vector<std::vector<double>>& polynomials,
                                        int largest) {
  PolynomialMeans out;
  for (const std::vector<double>& polynomial : polynomials) {
    const int length = static_cast<int>(polynomial.size());
    double with_means = 0, of_means = 0;
    for (int i = 0; i < length; ++i) {
      const int radius = window_radius(i, length, largest);
      const double mean = std::accumulate(polynomial.begin() + (i - radius),
                                          polynomial.begin() + (i + radius + 1), 0.0) /
                          window_width(i, length, largest);
      with_means += polynomial[as_index(i)] * mean;
      of_means += mean * mean;
    }
    out.with_means.push_back(with_means);
    out.of_means.push_back(of_means);
  }
  return out;
}

// A term's square less its mean in the windows is what it takes: |t|² - 2 t Wt + |Wt|².
inline KeptByLight kept_by(const LightPolynomial& light, const MosaicGeometry& geometry,
                           int channel) {
  const int rows = geometry.channel_rows(channel), cols = geometry.channel_cols(channel),
            largest = largest_radius(geometry, channel);
  const PolynomialMeans down = means_in_windows(light.down, largest),
                        right = means_in_windows(light.right, largest);
  double pixels = 0, of_rows = 0, of_cols = 0, left_rows = 0, left_cols = 0, left = 0;
  for (int r = 0; r < rows; ++r) left_rows += kept_of_line(r, rows, largest);
  for (int c = 0; c < cols; ++c) left_cols += kept_of_line(c, cols, largest);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) left += kept_variance(r, c, geometry, channel);
  for (std::size_t i = 0; i < light.down.size(); ++i)
    for (std::size_t j = 0; j < light.right.size(); ++j) {
      if (light.term(i, j) == 0) continue;
      pixels +=
          1 - 2 * down.with_means[i] * right.with_means[j] + down.of_means[i] * right.of_means[j];
      if (j == 0) of_rows += 1 - 2 * down.with_means[i] + down.of_means[i];
      if (i == 0) of_cols += 1 - 2 * right.with_means[j] + right.of_means[j];
    }
  const auto share = [](double taken, double all) { return all > taken ? 1.0 - taken / all : 1.0; };
  return {share(pixels, left), share(of_rows, left_rows), share(of_cols, left_cols)};
}

// Means over rectangular windows of one channel by sums over rectangles. Pixels that are left out
// (by mosaic row and column) are in no window. One that would hold next to none, as in a corner, is
// a 3x3 one, centred or not.
class WindowMean {
 public:
  template <class LeftOut>
  WindowMean(View<const float> mosaic, const MosaicGeometry& geometry, int channel,
             const LeftOut& left_out)
      : rows_(geometry.channel_rows(channel)),
        cols_(geometry.channel_cols(channel)),
        largest_radius_(largest_radius(geometry, channel)) {
    sums_.assign(as_index(rows_ + 1) * as_index(cols_ + 1), {});
    for_channel(geometry, channel, [&](int r, int c, int row, int col) {
      const bool used = !left_out(row, col);
      Sum& own = sum(r + 1, c + 1);
      own.value = (used ? double{mosaic(row, col)} : 0.0) + sum(r, c + 1).value +
                  sum(r + 1, c).value - sum(r, c).value;
      own.pixels = (used ? 1 : 0) + sum(r, c + 1).pixels + sum(r + 1, c).pixels - sum(r, c).pixels;
    });
  }
  struct Sum {
    double value = 0;
    int pixels = 0;
    double mean() const { return pixels > 0 ? value / pixels : 0.0; }
  };
  Sum around(int r, int c) {
    constexpr int kFewest = 3;
    const int down = window_radius(r, rows_, largest_radius_),
              right = window_radius(c, cols_, largest_radius_);
    const Sum window = within(r, c, down, right);
    return window.pixels >= kFewest ? window : within(r, c, std::max(down, 1), std::max(right, 1));
  }

 private:
  Sum& sum(int r, int c) { return sums_[as_index(r) * as_index(cols_ + 1) + as_index(c)]; }
  Sum within(int r, int c, int down, int right) {
    const int r0 = std::max(r - down, 0), r1 = std::min(r + down + 1, rows_);
    const int c0 = std::max(c - right, 0), c1 = std::min(c + right + 1, cols_);
    const Sum &a = sum(r0, c0), &b = sum(r0, c1), &d = sum(r1, c0), &e = sum(r1, c1);
    return {e.value - b.value - d.value + a.value, e.pixels - b.pixels - d.pixels + a.pixels};
  }
  int rows_, cols_, largest_radius_;
  std::vector<Sum> sums_;
};

}  // namespace malus
