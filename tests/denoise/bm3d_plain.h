// BM3D written down as it is defined, without any thought of speed: the fast code is compared with
// it.
#pragma once

#include "malus/denoise/internal/bm3d_parameters.h"
#include "malus/denoise/internal/bm3d_stage.h"
#include "malus/denoise/internal/bm3d_transform.h"
#include "malus/image/view.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

namespace malus::internal::plain {

/// Sample of the plane continued by reflection: ... 1 0 | 0 1 2 ...
inline float reflected(const Image& plane, int row, int col) {
  const auto fold = [](int i, int n) {
    i = ((i % (2 * n)) + 2 * n) % (2 * n);
    return i < n ? i : 2 * n - 1 - i;
  };
  return plane(fold(row, plane.rows()), fold(col, plane.cols()));
}

using Block = std::vector<double>;  // kPatchPixels values

inline Block transformed(const Block& x, const Matrix8& m) {
  Block half(kPatchPixels), out(kPatchPixels);
  for (int k = 0; k < kPatch; ++k)
    for (int c = 0; c < kPatch; ++c) {
      double sum = 0;
      for (int n = 0; n < kPatch; ++n) sum += m[k][n] * x[n * kPatch + c];
      half[k * kPatch + c] = sum;
    }
  for (int r = 0; r < kPatch; ++r)
    for (int k = 0; k < kPatch; ++k) {
      double sum = 0;
      for (int n = 0; n < kPatch; ++n) sum += m[k][n] * half[r * kPatch + n];
      out[r * kPatch + k] = sum;
    }
  return out;
}

/// Orthonormal Haar transform along the group: [0] the average, then details, coarse to fine.
inline void haar(std::vector<Block>& group) {
  for (std::size_t count = group.size(); count > 1; count /= 2) {
    const std::vector<Block> from(group.begin(), group.begin() + std::ptrdiff_t(count));
    for (std::size_t i = 0; i < count / 2; ++i)
      for (std::size_t p = 0; p < kPatchPixels; ++p) {
        group[i][p] = (from[2 * i][p] + from[2 * i + 1][p]) * std::sqrt(0.5);
        group[count / 2 + i][p] = (from[2 * i][p] - from[2 * i + 1][p]) * std::sqrt(0.5);
      }
  }
}

inline void inverse_haar(std::vector<Block>& group) {
  for (std::size_t count = 2; count <= group.size(); count *= 2) {
    const std::vector<Block> from(group.begin(), group.begin() + std::ptrdiff_t(count));
    for (std::size_t i = 0; i < count / 2; ++i)
      for (std::size_t p = 0; p < kPatchPixels; ++p) {
        group[2 * i][p] = (from[i][p] + from[count / 2 + i][p]) * std::sqrt(0.5);
        group[2 * i + 1][p] = (from[i][p] - from[count / 2 + i][p]) * std::sqrt(0.5);
      }
  }
}

struct Offset {
  int row, col;
};

inline std::vector<Offset> match(const Planes& planes, std::span<const double> scale,
                                 const Bm3dStage& stage, int row, int col) {
  struct Candidate {
    std::int64_t distance;
    int index;
    Offset offset;
  };
  const auto steps = [&](int c, int r, int q) {
    return std::lrint(static_cast<float>(scale[static_cast<std::size_t>(c)]) *
                      reflected(planes[c], r, q));
  };
  std::vector<Candidate> found;
  const auto order = search_order(stage.range);
  for (int index = 0; index < static_cast<int>(order.size()); ++index) {
    const auto [dy, dx] = order[static_cast<std::size_t>(index)];
    const auto beyond = [&](int start, int pixels) {
      return start < 0 || start > (lattice_size(pixels, stage.step) - 1) * stage.step;
    };
    if (beyond(row + dy, planes.rows()) || beyond(col + dx, planes.cols())) continue;
    std::int64_t distance = 0;
    for (int c = 0; c < planes.channels(); ++c)
      if (scale[static_cast<std::size_t>(c)] > 0)
        for (int p = 0; p < kPatchPixels; ++p) {
          const int r = row + p / kPatch, q = col + p % kPatch;
          const auto d =
              std::min<std::int64_t>(std::abs(steps(c, r, q) - steps(c, r + dy, q + dx)), 255);
          distance += d * d;
        }
    if (distance < kMatchFullScale) found.push_back({index == 0 ? -1 : distance, index, {dy, dx}});
  }
  std::sort(found.begin(), found.end(), [](const Candidate& a, const Candidate& b) {
    return a.distance != b.distance ? a.distance < b.distance : a.index < b.index;
  });
  std::size_t count = 1;
  while (count * 2 <= found.size() && count * 2 <= static_cast<std::size_t>(stage.group))
    count *= 2;
  std::vector<Offset> group;
  for (std::size_t i = 0; i < count; ++i) group.push_back(found[i].offset);
  return group;
}

/// One pass over all reference blocks. Without a pilot: hard threshold; with one: Wiener filter
/// steered by it.
inline Planes pass(const Planes& noisy, std::span<const float> sigma,
                   std::span<const float> match_weights, const Bm3dStage& stage,
                   float hard_threshold, const Planes* pilot) {
  const int channels = noisy.channels(), rows = noisy.rows(), cols = noisy.cols();
  const Matrix8 forward = pilot ? dct_matrix() : biorthogonal_matrix();
  Matrix8 inverse{};
  if (pilot)
    for (int k = 0; k < kPatch; ++k)
      for (int n = 0; n < kPatch; ++n) inverse[n][k] = forward[k][n];
  else
    inverse = biorthogonal_inverse();
  const auto window = kaiser_window();
  double total = 0;
  for (int c = 0; c < channels; ++c)
    if (sigma[c] > 0) total += match_weights[c];
  std::vector<double> scale(static_cast<std::size_t>(channels), 0.0);
  for (int c = 0; c < channels; ++c)
    if (sigma[c] > 0 && match_weights[c] > 0)
      scale[c] = match_scale(stage.match_limit, match_weights[c] / total, sigma[c]);

  Planes numerator(channels, rows, cols), denominator(channels, rows, cols);
  for (int i = 0; i < lattice_size(rows, stage.step); ++i)
    for (int j = 0; j < lattice_size(cols, stage.step); ++j) {
      const int row = i * stage.step, col = j * stage.step;
      const auto offsets = match(pilot ? *pilot : noisy, scale, stage, row, col);
      for (int c = 0; c < channels; ++c) {
        if (!(sigma[c] > 0)) continue;
        const auto load = [&](const Image& plane) {
          std::vector<Block> group;
          for (const auto& o : offsets) {
            Block block(kPatchPixels);
            for (int p = 0; p < kPatchPixels; ++p)
              block[p] = reflected(plane, row + o.row + p / kPatch, col + o.col + p % kPatch);
            group.push_back(transformed(block, forward));
          }
          haar(group);
          return group;
        };
        auto group = load(noisy[c]);
        double energy = 0;
        if (pilot) {
          const auto guide = load((*pilot)[c]);
          for (std::size_t g = 0; g < group.size(); ++g)
            for (int p = 0; p < kPatchPixels; ++p) {
              const double power = guide[g][p] * guide[g][p];
              const double gain =
                  g == 0 && p == 0 ? 1 : power / (power + double(sigma[c]) * sigma[c]);
              group[g][p] *= gain;
              energy += gain * gain;
            }
        } else {
          for (std::size_t g = 0; g < group.size(); ++g)
            for (int p = 0; p < kPatchPixels; ++p) {
              const bool keep =
                  (g == 0 && p == 0) || std::abs(group[g][p]) > double(hard_threshold) * sigma[c];
              if (!keep) group[g][p] = 0;
              energy += keep;
            }
        }
        inverse_haar(group);
        for (std::size_t g = 0; g < group.size(); ++g) {
          const Block block = transformed(group[g], inverse);
          for (int p = 0; p < kPatchPixels; ++p) {
            const int r = row + offsets[g].row + p / kPatch, q = col + offsets[g].col + p % kPatch;
            if (r < 0 || q < 0 || r >= rows || q >= cols) continue;
            const double weight = window[p / kPatch] * window[p % kPatch] * std::pow(energy, -0.75);
            numerator[c](r, q) += static_cast<float>(weight * block[p]);
            denominator[c](r, q) += static_cast<float>(weight);
          }
        }
      }
    }
  Planes result = noisy;
  for (int c = 0; c < channels; ++c)
    if (sigma[c] > 0)
      for (std::size_t p = 0; p < result[c].size(); ++p)
        result[c].values()[p] = numerator[c].values()[p] / denominator[c].values()[p];
  return result;
}

}  // namespace malus::internal::plain
