#include "malus/polar/internal/residual_angles.h"

#include "malus/polar/internal/bayer.h"
#include "malus/polar/internal/lattice.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace malus::internal {
namespace {

// Of the guided filter's epsilon: error of Malus's law that says nothing.
constexpr double kMalusFloor = 0.01;
constexpr float kNoneOfS0 = 0.45f, kMostOfS0 = 0.65f;  // shares of S0

// |difference| of pixels two apart, averaged over 3x3: same angle on both sides.
struct Gradients {
  Image down, right;  // between (r, c) and (r + 2, c), (r, c + 2)
};

Gradients gradients_of(const Image& mosaic) {
  const int rows = mosaic.rows(), cols = mosaic.cols();
  Image down(rows, cols), right(rows, cols);
  for_rows(rows, [&](int r) {
    for (int c = 0; c < cols; ++c) {
      down(r, c) = std::abs(mosaic(mirrored(r + 2, rows), c) - mosaic(r, c));
      right(r, c) = std::abs(mosaic(r, mirrored(c + 2, cols)) - mosaic(r, c));
    }
  });
  return {box_mean(down, 1), box_mean(right, 1)};
}

// Half of S0 at every pixel: the mean of the 2x2 blocks around it, those across an edge weighted
// down. A block of any phase holds the four angles once.
Image intensity_guide(const Image& mosaic, double mean_square) {
  const int rows = mosaic.rows(), cols = mosaic.cols();
  const Gradients gradients = gradients_of(mosaic);
  const auto floor = static_cast<float>(kGradientFloor * std::sqrt(mean_square) + kTinyDn);
  const auto weight = [&](float gradient) { return 1 / ((gradient + floor) * (gradient + floor)); };
  Image guide(rows, cols);
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
      const int up = mirrored(r - 1, rows), below = mirrored(r + 1, rows);
      const int up2 = mirrored(r - 2, rows);
      for (int c = 0; c < cols; ++c) {
        const int left = mirrored(c - 1, cols), next = mirrored(c + 1, cols);
        const float north = weight(gradients.down(up2, c)), south = weight(gradients.down(r, c));
        const float west = weight(gradients.right(r, mirrored(c - 2, cols)));
        const float east = weight(gradients.right(r, c));
        const auto block = [&](int row, int col) {
          return 0.25f * (mosaic(r, c) + mosaic(row, c) + mosaic(r, col) + mosaic(row, col));
        };
        guide(r, c) = (south * (east * block(below, next) + west * block(below, left)) +
                       north * (east * block(up, next) + west * block(up, left))) /
                      ((south + north) * (east + west));
      }
    }
  });
  return guide;
}

// [angle / 45]
using AngleImages = std::array<Image, 4>;

// make(samples of one angle, their places) for every angle of 2x2 blocks.
template <class Make>
AngleImages for_angles(const Image& mosaic, const SensorLayout& layout, const Make& make) {
  AngleImages images;
  for (int r = 0; r < 2; ++r)
    for (int c = 0; c < 2; ++c) {
      const Lattice lattice{r, c, 2};
      const auto angle = static_cast<std::size_t>(*layout.site(layout.channel_at(r, c)).angle_deg);
      images[angle / 45] = make(sampled(mosaic, lattice), lattice);
    }
  return images;
}

// By how much I0 + I90 = I45 + I135 is missed around a pixel, squared: the true pictures never do.
Image malus_error(const AngleImages& angles) {
  constexpr int kRadius = 3;
  Image error(angles[0].rows(), angles[0].cols());
  for_rows(error.rows(), [&](int r) {
    for (int c = 0; c < error.cols(); ++c) {
      const float missed = angles[0](r, c) + angles[2](r, c) - angles[1](r, c) - angles[3](r, c);
      error(r, c) = missed * missed;
    }
  });
  return box_mean(error, kRadius);
}

// Where the polarization alone changes, S0 has no edge that could guide the angles: the guide's own
// errors would. Such places show in the share of S0, and as guided pictures that miss Malus's law
// by more than interpolated ones, which at edges of S0 they do by far less.
float trust_in_guide(float s0_takes_part, float guided_error, float interpolated_error) {
  constexpr float kLimit = 1.6f;  // of the errors' ratio; guided pictures are sharper
  const float ratio = guided_error / (kLimit * interpolated_error);
  const float to_4 = ratio * ratio * ratio * ratio;
  return s0_takes_part / (1 + to_4 * to_4);
}

// As ResidualAngles says.
Image s0_takes_part(const Image& mosaic) {
  constexpr int kRadius = 3;
  const int rows = mosaic.rows(), cols = mosaic.cols();
  Image blocks(rows, cols), of_s0(rows, cols), of_angles(rows, cols);
  for_rows(rows, [&](int r) {
    const int below = mirrored(r + 1, rows);
    for (int c = 0; c < cols; ++c) {
      const int next = mirrored(c + 1, cols);
      blocks(r, c) =
          0.25f * (mosaic(r, c) + mosaic(r, next) + mosaic(below, c) + mosaic(below, next));
    }
  });
  const auto differences = [&](const Image& image, Image& sizes) {
    for_rows(rows, [&](int r) {
      const int below = mirrored(r + 2, rows);
      for (int c = 0; c < cols; ++c)
        sizes(r, c) = std::abs(image(below, c) - image(r, c)) +
                      std::abs(image(r, mirrored(c + 2, cols)) - image(r, c));
    });
    sizes = box_mean(sizes, kRadius);
  };
  differences(blocks, of_s0);
  differences(mosaic, of_angles);
  for (std::size_t i = 0; i < of_s0.size(); ++i) {
    const float all = of_angles.values()[i];
    const float share = all > 0 ? of_s0.values()[i] / all : 1;
    of_s0.values()[i] = std::clamp((share - kNoneOfS0) / (kMostOfS0 - kNoneOfS0), 0.0f, 1.0f);
  }
  return of_s0;
}

}  // namespace

ResidualAngles residual_angles(const Image& mosaic, const SensorLayout& layout, double epsilon,
                               double mean_square) {
  const auto interpolate = [&](const Image& samples, const Lattice& lattice) {
    return upsampled(samples, lattice, mosaic.rows(), mosaic.cols());
  };
  const Image guide = intensity_guide(mosaic, mean_square);
  AngleImages planes =
      for_angles(mosaic, layout, [&](const Image& samples, const Lattice& lattice) {
        return guided_upsampled(samples, lattice, guide, epsilon);
      });
  const AngleImages interpolated = for_angles(mosaic, layout, interpolate);
  const Image guided_error = malus_error(planes), error = malus_error(interpolated);
  Image share = s0_takes_part(mosaic);
  const auto tiny = static_cast<float>(kMalusFloor * epsilon);
  for_rows(mosaic.rows(), [&](int r) {
    for (int c = 0; c < mosaic.cols(); ++c) {
      const float trust =
          trust_in_guide(share(r, c), guided_error(r, c) + tiny, error(r, c) + tiny);
      for (std::size_t a = 0; a < planes.size(); ++a)
        planes[a](r, c) = interpolated[a](r, c) + trust * (planes[a](r, c) - interpolated[a](r, c));
    }
  });
  const AnglePlanes angles{std::move(planes[0]), std::move(planes[1]), std::move(planes[2]),
                           std::move(planes[3])};
  return {stokes_of(angles), std::move(share)};
}

}  // namespace malus::internal
