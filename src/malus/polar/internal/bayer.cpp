#include "malus/polar/internal/bayer.h"

#include "malus/polar/internal/lattice.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

namespace malus::internal {
namespace {

// Green at every pixel of a Bayer picture: Hamilton and Adams (US patent 5629734, 1997), both
// directions weighted by their inverse squared gradients instead of a choice between them.
Image green_of(const Image& bayer, const std::function<bool(int, int)>& is_green) {
  const int rows = bayer.rows(), cols = bayer.cols();
  Image across(rows, cols), down(rows, cols), slope_across(rows, cols), slope_down(rows, cols);
  const auto estimate = [](float a, float b, float far_a, float far_b, float here, float& value,
                           float& slope) {
    const float curvature = 2 * here - far_a - far_b;
    value = 0.5f * (a + b) + 0.25f * curvature;
    slope = std::abs(a - b) + 0.25f * std::abs(curvature);
  };
  for_rows(rows, [&](int r) {
    for (int c = 0; c < cols; ++c) {
      const auto at = [&](int dr, int dc) {
        return bayer(mirrored(r + dr, rows), mirrored(c + dc, cols));
      };
      estimate(at(0, -1), at(0, 1), at(0, -2), at(0, 2), at(0, 0), across(r, c),
               slope_across(r, c));
      estimate(at(-1, 0), at(1, 0), at(-2, 0), at(2, 0), at(0, 0), down(r, c), slope_down(r, c));
    }
  });
  slope_across = box_mean(slope_across, 1);
  slope_down = box_mean(slope_down, 1);
  const auto floor = static_cast<float>(kGradientFloor * std::sqrt(mean_square(bayer)) + kTinyDn);
  Image green = bayer;
  for_rows(rows, [&](int r) {
    for (int c = 0; c < cols; ++c) {
      if (is_green(r, c)) continue;
      const float h = 1 / ((slope_across(r, c) + floor) * (slope_across(r, c) + floor));
      const float v = 1 / ((slope_down(r, c) + floor) * (slope_down(r, c) + floor));
      const int up = mirrored(r - 1, rows), below = mirrored(r + 1, rows);
      const int left = mirrored(c - 1, cols), next = mirrored(c + 1, cols);
      const float least = std::min({bayer(up, c), bayer(below, c), bayer(r, left), bayer(r, next)});
      green(r, c) = not_far_below(least, (h * across(r, c) + v * down(r, c)) / (h + v));
    }
  });
  return green;
}

}  // namespace

double mean_square(const Image& image) {
  double sum = 0;
  for (float v : image.values()) sum += double{v} * double{v};
  return sum / static_cast<double>(image.size());
}

bool is_usable(float dn) {
  constexpr float kMostDn = 1e15f;
  return std::abs(dn) < kMostDn;  // NaN is not
}

// From the rim inwards, a ring of the same channel's pixels at a time.
Image filled(View<const float> mosaic, const SensorLayout& layout) {
  struct Place {
    int row, col;
  };
  Image out(mosaic.rows(), mosaic.cols());
  const auto around = [&](const Place& place, auto visit) {
    for (int dr = -1; dr <= 1; ++dr)
      for (int dc = -1; dc <= 1; ++dc) {
        const int row = place.row + dr * layout.rows(), col = place.col + dc * layout.cols();
        if (row >= 0 && col >= 0 && row < out.rows() && col < out.cols()) visit(row, col);
      }
  };
  const auto mean_around = [&](const Place& place) {
    double sum = 0;
    int count = 0;
    around(place, [&](int row, int col) {
      if (is_usable(out(row, col))) sum += out(row, col), ++count;
    });
    return count > 0 ? static_cast<float>(sum / count) : std::numeric_limits<float>::quiet_NaN();
  };
  std::vector<Place> holes, rim;
  for (int r = 0; r < out.rows(); ++r)
    for (int c = 0; c < out.cols(); ++c) {
      out(r, c) = mosaic(r, c);
      if (!is_usable(out(r, c))) holes.push_back({r, c});
    }
  Plane<std::uint8_t> waits(out.rows(), out.cols());
  for (const Place& hole : holes) {
    const bool beside_light = !std::isnan(mean_around(hole));
    if (beside_light) rim.push_back(hole);
    waits(hole.row, hole.col) = !beside_light;
  }
  while (!rim.empty()) {
    std::vector<float> means;
    for (const Place& hole : rim) means.push_back(mean_around(hole));
    for (std::size_t i = 0; i < rim.size(); ++i) out(rim[i].row, rim[i].col) = means[i];
    std::vector<Place> next;
    for (const Place& hole : rim)
      around(hole, [&](int row, int col) {
        if (std::exchange(waits(row, col), std::uint8_t{0})) next.push_back({row, col});
      });
    rim = std::move(next);
  }
  for (const Place& hole : holes)
    if (waits(hole.row, hole.col)) out(hole.row, hole.col) = 0.0f;  // nothing to fill it from
  return out;
}

std::map<Color, Image> bayer_colors(const Image& bayer,
                                    const std::function<Color(int, int)>& color_at,
                                    double epsilon) {
  std::map<Color, Image> full;
  const Image& green = full[Color::kGreen1] =
      green_of(bayer, [&](int r, int c) { return color_at(r, c) == Color::kGreen1; });
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 2; ++c) {
      if (color_at(r, c) == Color::kGreen1) continue;
      const Lattice own{r, c, 2};
      full[color_at(r, c)] = guided_upsampled(sampled(bayer, own), own, green, epsilon);
    }
  return full;
}

}  // namespace malus::internal
