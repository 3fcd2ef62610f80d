#include "malus/polar/internal/lattice.h"

#include <algorithm>
#include <utility>
#include <vector>

namespace malus::internal {
namespace {

// value(i) of every element of equally sized images.
template <class Function>
Image map_elements(const Image& like, Function value) {
  Image out(like.rows(), like.cols());
  for_rows(like.rows(), [&](int r) {
    const std::size_t begin = static_cast<std::size_t>(r) * static_cast<std::size_t>(like.cols());
    for (std::size_t i = begin; i < begin + static_cast<std::size_t>(like.cols()); ++i)
      out.values()[i] = value(i);
  });
  return out;
}

struct Step {
  int low, high;
  float part;  // of high
};

// Where full-resolution positions fall between lattice samples along one axis.
std::vector<Step> steps(int full, int offset, int stride, int coarse) {
  std::vector<Step> all;
  for (int x = 0; x < full; ++x) {
    const float position = std::clamp(static_cast<float>(x - offset) / static_cast<float>(stride),
                                      0.0f, static_cast<float>(coarse - 1));
    const int low = static_cast<int>(position);
    all.push_back({low, std::min(low + 1, coarse - 1), position - static_cast<float>(low)});
  }
  return all;
}

// At (r, c) the least of rows r - 1 to r + 2 and columns c - 1 to c + 2: the 4x4 samples around
// what lies between (r, c) and (r + 1, c + 1).
Image least_around(const Image& samples) {
  const int rows = samples.rows(), cols = samples.cols();
  Image across(rows, cols), least(rows, cols);
  for_rows(rows, [&](int r) {
    const float* from = samples.row(r);
    for (int c = 0; c < cols; ++c)
      across(r, c) =
          *std::min_element(from + std::max(c - 1, 0), from + std::min(c + 2, cols - 1) + 1);
  });
  for_rows(rows, [&](int r) {
    for (int c = 0; c < cols; ++c) {
      least(r, c) = across(r, c);
      for (int i = std::max(r - 1, 0); i <= std::min(r + 2, rows - 1); ++i)
        least(r, c) = std::min(least(r, c), across(i, c));
    }
  });
  return least;
}

// Full-resolution values, none of them far below the samples around it.
Image limited(Image full, const Image& samples, const Lattice& lattice) {
  const Image least = least_around(samples);
  const auto down = steps(full.rows(), lattice.row, lattice.stride, samples.rows());
  const auto right = steps(full.cols(), lattice.col, lattice.stride, samples.cols());
  for_rows(full.rows(), [&](int r) {
    const float* around = least.row(down[static_cast<std::size_t>(r)].low);
    float* values = full.row(r);
    for (int c = 0; c < full.cols(); ++c)
      values[c] = not_far_below(around[right[static_cast<std::size_t>(c)].low], values[c]);
  });
  return full;
}

}  // namespace

Image sampled(View<const float> full, const Lattice& lattice) {
  const auto count = [&](int size, int offset) {
    return std::max(0, (size - offset + lattice.stride - 1) / lattice.stride);
  };
  Image out(count(full.rows(), lattice.row), count(full.cols(), lattice.col));
  MALUS_REQUIRE(!out.empty());
  for_rows(out.rows(), [&](int r) {
    const float* from = full.row(lattice.row + r * lattice.stride) + lattice.col;
    for (int c = 0; c < out.cols(); ++c) out(r, c) = from[c * lattice.stride];
  });
  return out;
}

Image upsampled(const Image& coarse, const Lattice& lattice, int rows, int cols) {
  const auto down = steps(rows, lattice.row, lattice.stride, coarse.rows());
  const auto right = steps(cols, lattice.col, lattice.stride, coarse.cols());
  Image out(rows, cols);
  for_rows(rows, [&](int r) {
    const Step& v = down[static_cast<std::size_t>(r)];
    const float *above = coarse.row(v.low), *below = coarse.row(v.high);
    float* to = out.row(r);
    for (int c = 0; c < cols; ++c) {
      const Step& h = right[static_cast<std::size_t>(c)];
      const float left = above[h.low] + v.part * (below[h.low] - above[h.low]);
      const float next = above[h.high] + v.part * (below[h.high] - above[h.high]);
      to[c] = left + h.part * (next - left);
    }
  });
  return out;
}

// Every window is summed for itself, not slid on from the one before: so a pixel depends on its
// window alone, and a band of a picture gives the bits of the whole.
Image box_mean(const Image& image, int radius) {
  const int rows = image.rows(), cols = image.cols();
  Image out(rows, cols);
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    // With zeros beyond both ends, so that no window is cut.
    std::vector<double> column(static_cast<std::size_t>(cols + 2 * radius), 0.0);
    std::vector<double> sum(static_cast<std::size_t>(cols));
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
      const int top = std::max(r - radius, 0), bottom = std::min(r + radius, rows - 1);
      double* const middle = column.data() + radius;
      std::copy_n(image.row(top), cols, middle);
      for (int i = top + 1; i <= bottom; ++i) {
        const float* row = image.row(i);
        for (int c = 0; c < cols; ++c) middle[c] += double{row[c]};
      }
      std::copy_n(column.data(), cols, sum.data());
      for (int d = 1; d <= 2 * radius; ++d)
        for (int c = 0; c < cols; ++c)
          sum[static_cast<std::size_t>(c)] += column[static_cast<std::size_t>(c + d)];
      const double height = bottom - top + 1;
      const auto mean = [&](int c) {
        const int width = std::min(c + radius, cols - 1) - std::max(c - radius, 0) + 1;
        out(r, c) = static_cast<float>(sum[static_cast<std::size_t>(c)] / (height * width));
      };
      float* to = out.row(r);
      const int left = std::min(radius, cols), right = std::max(left, cols - radius);
      for (int c = 0; c < left; ++c) mean(c);
      for (int c = left; c < right; ++c)
        to[c] = static_cast<float>(sum[static_cast<std::size_t>(c)] / (height * (2 * radius + 1)));
      for (int c = right; c < cols; ++c) mean(c);
    }
  });
  return out;
}

Image smoothed(const Image& image) {
  const int rows = image.rows(), cols = image.cols();
  Image out(rows, cols);
  for_rows(rows, [&](int r) {
    const float *a = image.row(mirrored(r - 1, rows)), *b = image.row(r),
                *d = image.row(mirrored(r + 1, rows));
    const auto vertical = [&](int c) { return a[c] + 2 * b[c] + d[c]; };
    for (int c = 0; c < cols; ++c)
      out(r, c) =
          (vertical(mirrored(c - 1, cols)) + 2 * vertical(c) + vertical(mirrored(c + 1, cols))) /
          16;
  });
  return out;
}

Image guided_upsampled(const Image& samples, const Lattice& lattice, const Image& guide,
                       double epsilon) {
  constexpr int kRadius = 2;  // lattice steps: windows of 5x5 samples
  const Image at_samples = sampled(guide, lattice);
  MALUS_REQUIRE(at_samples.rows() == samples.rows() && at_samples.cols() == samples.cols());
  const std::vector<float>&y = samples.values(), &g = at_samples.values();
  const Image mean_y = box_mean(samples, kRadius), mean_g = box_mean(at_samples, kRadius);
  // Deviations from the local mean at the sample itself keep the products small and exact.
  const auto dy = [&](std::size_t i) { return y[i] - mean_y.values()[i]; };
  const auto dg = [&](std::size_t i) { return g[i] - mean_g.values()[i]; };
  const Image covariance =
      box_mean(map_elements(samples, [&](std::size_t i) { return dg(i) * dy(i); }), kRadius);
  const Image variance_g =
      box_mean(map_elements(samples, [&](std::size_t i) { return dg(i) * dg(i); }), kRadius);
  const Image variance_y =
      box_mean(map_elements(samples, [&](std::size_t i) { return dy(i) * dy(i); }), kRadius);
  const auto eps = static_cast<float>(epsilon);
  const Image slope = map_elements(samples, [&](std::size_t i) {
    return covariance.values()[i] / (variance_g.values()[i] + eps);
  });
  // Windows that the guide explains badly count less.
  const Image weight = map_elements(samples, [&](std::size_t i) {
    const float unexplained = variance_y.values()[i] - slope.values()[i] * covariance.values()[i];
    return 1 / (std::max(unexplained, 0.0f) + 0.01f * eps);
  });
  const Image weight_mean = box_mean(weight, kRadius);
  const Image weighted = box_mean(
      map_elements(samples, [&](std::size_t i) { return weight.values()[i] * slope.values()[i]; }),
      kRadius);
  const Image a = map_elements(
      samples, [&](std::size_t i) { return weighted.values()[i] / weight_mean.values()[i]; });
  const Image rest =
      map_elements(samples, [&](std::size_t i) { return y[i] - a.values()[i] * g[i]; });
  const int rows = guide.rows(), cols = guide.cols();
  const Image a_full = upsampled(a, lattice, rows, cols);
  const Image rest_full = upsampled(rest, lattice, rows, cols);
  Image full = map_elements(guide, [&](std::size_t i) {
    return rest_full.values()[i] + a_full.values()[i] * guide.values()[i];
  });
  return limited(std::move(full), samples, lattice);
}

}  // namespace malus::internal
