#include "malus/evaluate/image_metrics.h"

#include "malus/base/parallel.h"

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kWindow = 11, kWindowReach = kWindow / 2;

const std::array<double, kWindow>& gaussian_window() {
  static const std::array<double, kWindow> weights = [] {
    constexpr double kSigma = 1.5;
    std::array<double, kWindow> w{};
    double sum = 0;
    for (int i = 0; i < kWindow; ++i) {
      const double x = (i - kWindowReach) / kSigma;
      sum += w[static_cast<std::size_t>(i)] = std::exp(-0.5 * x * x);
    }
    for (double& v : w) v /= sum;
    return w;
  }();
  return weights;
}

// Weighted first and second moments of the two pictures inside a window.
struct LocalMoments {
  double a = 0, b = 0, aa = 0, bb = 0, ab = 0;
  void add(double weight, const LocalMoments& m) {
    a += weight * m.a;
    b += weight * m.b;
    aa += weight * m.aa;
    bb += weight * m.bb;
    ab += weight * m.ab;
  }
};

double ssim_of(const LocalMoments& m, double peak) {
  const double c1 = (0.01 * peak) * (0.01 * peak), c2 = (0.03 * peak) * (0.03 * peak);
  const double variance_a = m.aa - m.a * m.a, variance_b = m.bb - m.b * m.b;
  const double covariance = m.ab - m.a * m.b;
  return (2 * m.a * m.b + c1) * (2 * covariance + c2) /
         ((m.a * m.a + m.b * m.b + c1) * (variance_a + variance_b + c2));
}

struct Mean {
  double sum = 0;
  std::int64_t count = 0;
};

// The windows centred on one row: columns of the pictures are weighted vertically first.
Mean ssim_row(View<const float> reference, View<const float> test, int row, double peak,
              std::vector<LocalMoments>& columns) {
  const auto& weights = gaussian_window();
  for (int c = 0; c < reference.cols(); ++c) {
    LocalMoments column;
    for (int k = 0; k < kWindow; ++k) {
      const double a = reference(row - kWindowReach + k, c), b = test(row - kWindowReach + k, c);
      column.add(weights[static_cast<std::size_t>(k)], {a, b, a * a, b * b, a * b});
    }
    columns[static_cast<std::size_t>(c)] = column;
  }
  Mean mean;
  for (int c = kWindowReach; c + kWindowReach < reference.cols(); ++c) {
    LocalMoments window;
    for (int k = 0; k < kWindow; ++k)
      window.add(weights[static_cast<std::size_t>(k)],
                 columns[static_cast<std::size_t>(c - kWindowReach + k)]);
    const double value = ssim_of(window, peak);
    if (!std::isfinite(value)) continue;
    mean.sum += value;
    ++mean.count;
  }
  return mean;
}

}  // namespace

SquaredError squared_error(View<const float> a, View<const float> b) {
  MALUS_REQUIRE(a.rows() == b.rows() && a.cols() == b.cols());
  return parallel_reduce(
      0, a.rows(), kRowsPerTask, SquaredError{},
      [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        SquaredError error;
        for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
          for (int c = 0; c < a.cols(); ++c) {
            const double d = double{a(r, c)} - double{b(r, c)};
            if (!std::isfinite(d)) continue;
            error.sum += d * d;
            ++error.count;
          }
        return error;
      },
      [](const SquaredError& x, const SquaredError& y) {
        return SquaredError{x.sum + y.sum, x.count + y.count};
      });
}

Estimate<double> psnr_db(const SquaredError& error, double peak) {
  MALUS_REQUIRE(peak > 0);
  if (error.count == 0) return Undecided{"no pixel is finite in both pictures"};
  if (error.sum == 0) return std::numeric_limits<double>::infinity();
  return 10 * std::log10(peak * peak / error.mean());
}

Estimate<double> psnr_db(const Planes& reference, const Planes& test, double peak) {
  MALUS_REQUIRE(reference.channels() == test.channels());
  SquaredError total;
  for (int k = 0; k < reference.channels(); ++k) {
    const SquaredError error = squared_error(reference[k], test[k]);
    total.sum += error.sum;
    total.count += error.count;
  }
  return psnr_db(total, peak);
}

Estimate<double> ssim(View<const float> reference, View<const float> test, double peak) {
  MALUS_REQUIRE(reference.rows() == test.rows() && reference.cols() == test.cols() && peak > 0);
  const int rows = reference.rows(), cols = reference.cols();
  if (rows < kWindow || cols < kWindow)
    return Undecided{fmt::format("{}x{} pixels are fewer than the window's {}x{}", cols, rows,
                                 kWindow, kWindow)};
  const Mean mean = parallel_reduce(
      kWindowReach, rows - kWindowReach, kRowsPerTask, Mean{},
      [&](std::ptrdiff_t first, std::ptrdiff_t last) {
        std::vector<LocalMoments> columns(static_cast<std::size_t>(cols));
        Mean part;
        for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
          const Mean row = ssim_row(reference, test, r, peak, columns);
          part.sum += row.sum;
          part.count += row.count;
        }
        return part;
      },
      [](const Mean& a, const Mean& b) {
        return Mean{a.sum + b.sum, a.count + b.count};
      });
  if (mean.count == 0) return Undecided{"every window holds a pixel that is not finite"};
  return mean.sum / static_cast<double>(mean.count);
}

Estimate<double> ssim(const Planes& reference, const Planes& test, double peak) {
  MALUS_REQUIRE(reference.channels() == test.channels() && reference.channels() > 0);
  double sum = 0;
  for (int k = 0; k < reference.channels(); ++k) {
    const Estimate<double> value = ssim(reference[k].view(), test[k].view(), peak);
    if (!value) return value;
    sum += *value;
  }
  return sum / reference.channels();
}

}  // namespace malus
