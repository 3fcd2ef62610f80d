#include "malus/denoise/internal/baselines.h"

#include "malus/base/statistics.h"
#include "malus/denoise/bm3d.h"
#include "malus/denoise/internal/memory_budget.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <cmath>
#include <set>

#include <Eigen/Eigenvalues>

namespace malus::internal {
namespace {

// Deviation of white noise from the median of diagonal second differences of 2x2 pixels, the finest
// Haar wavelet band (Donoho, Johnstone, Biometrika 81, 1994).
double estimated_deviation(const Image& plane) {
  std::vector<double> detail;
  for (int r = 0; r + 1 < plane.rows(); r += 2)
    for (int c = 0; c + 1 < plane.cols(); c += 2)
      detail.push_back(
          0.5 * std::abs(plane(r, c) - plane(r, c + 1) - plane(r + 1, c) + plane(r + 1, c + 1)));
  return detail.empty() ? 0.0 : median_of(std::move(detail)) / kMedianOfNormal;
}

void filter_each(Planes& planes, const std::vector<float>& sigma, const Bm3dSettings& settings,
                 Progress& progress) {
  for (int k = 0; k < planes.channels(); ++k) {
    Planes one(1, 0, 0);
    one[0] = std::move(planes[k]);
    planes[k] = std::move(
        bm3d(one, std::span(&sigma[static_cast<std::size_t>(k)], 1), settings, {}, progress)[0]);
  }
}

// The channels of one grey picture of 000 Table 1, row by row of its cell: the four angles of one
// colour (either green for itself), or one channel without companions.
using GreyPicture = std::vector<int>;

// The nearest sites to the right of, below and aslant of a channel's that are not taken and
// complete the four angles of its colour.
GreyPicture angles_around(const SensorLayout& layout, int channel, const std::vector<bool>& taken) {
  const Site& first = layout.site(channel);
  const int row = channel / layout.cols(), col = channel % layout.cols();
  for (int r = row + 1; first.angle_deg && r < layout.rows(); ++r)
    for (int c = col + 1; c < layout.cols(); ++c) {
      const GreyPicture four{channel, layout.channel_at(row, c), layout.channel_at(r, col),
                             layout.channel_at(r, c)};
      std::set<int> angles;
      for (const int k : four)
        if (const Site& site = layout.site(k);
            !taken[static_cast<std::size_t>(k)] && site.color == first.color && site.angle_deg)
          angles.insert(*site.angle_deg);
      if (angles.size() == 4) return four;
    }
  return {channel};
}

std::vector<GreyPicture> grey_pictures(const SensorLayout& layout) {
  std::vector<bool> taken(static_cast<std::size_t>(layout.channels()));
  std::vector<GreyPicture> pictures;
  for (int k = 0; k < layout.channels(); ++k) {
    if (taken[static_cast<std::size_t>(k)]) continue;
    pictures.push_back(angles_around(layout, k, taken));
    for (const int channel : pictures.back()) taken[static_cast<std::size_t>(channel)] = true;
  }
  return pictures;
}

// "BM3D, taking each color channel containing 4 polarization channels as a grayscale input" (000,
// 6.1), its noise estimated from the picture.
void filter_grey_pictures(Planes& planes, const SensorLayout& layout, double strength,
                          const Bm3dSettings& settings, Progress& progress) {
  for (const GreyPicture& channels : grey_pictures(layout)) {
    const int side = channels.size() == 4 ? 2 : 1;
    const int rows = planes[channels[0]].rows(), cols = planes[channels[0]].cols();
    Planes grey(1, side * rows, side * cols);
    const auto pixel = [&](std::size_t k, int r, int c) -> float& {
      const int i = static_cast<int>(k);
      return grey[0](side * r + i / side, side * c + i % side);
    };
    for (std::size_t k = 0; k < channels.size(); ++k) {
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c) pixel(k, r, c) = planes[channels[k]](r, c);
      planes[channels[k]] = Image();  // not held while the filter runs
    }
    const auto sigma = static_cast<float>(strength * estimated_deviation(grey[0]));
    grey = bm3d(grey, std::span(&sigma, 1), settings, {}, progress);
    for (std::size_t k = 0; k < channels.size(); ++k) {
      planes[channels[k]] = Image(rows, cols);
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c) planes[channels[k]](r, c) = pixel(k, r, c);
    }
  }
}

void stabilise(Planes& planes, const std::vector<Stabilizer>& stabilizers, bool back) {
  for (int k = 0; k < planes.channels(); ++k) {
    const Stabilizer& s = stabilizers[static_cast<std::size_t>(k)];
    for (float& v : planes[k].values()) v = static_cast<float>(back ? s.inverse(v) : s.forward(v));
  }
}

Eigen::MatrixXd principal_components(const Planes& planes) {
  const int n = planes.channels();
  Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(n, n);
  std::vector<double> mean;
  for (int k = 0; k < n; ++k) {
    double sum = 0;
    for (const float v : planes[k].values()) sum += v;
    mean.push_back(sum / static_cast<double>(planes[k].size()));
  }
  for (int a = 0; a < n; ++a)
    for (int b = 0; b <= a; ++b) {
      double sum = 0;
      for (std::size_t i = 0; i < planes[a].size(); ++i)
        sum += (planes[a].values()[i] - mean[static_cast<std::size_t>(a)]) *
               (planes[b].values()[i] - mean[static_cast<std::size_t>(b)]);
      covariance(a, b) = covariance(b, a) = sum / static_cast<double>(planes[a].size());
    }
  return Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(covariance).eigenvectors();
}

// Rows: S0, S1, S2 and the redundant difference of every colour's four angles, orthonormal.
// Channels without three companions stay as they are.
Eigen::MatrixXd stokes_components(const SensorLayout& layout) {
  const int n = layout.channels();
  Eigen::MatrixXd matrix = Eigen::MatrixXd::Identity(n, n);
  const double root = std::sqrt(0.5);
  const double rows[4][4] = {
      {0.5, 0.5, 0.5, 0.5}, {root, 0, -root, 0}, {0, root, 0, -root}, {0.5, -0.5, 0.5, -0.5}};
  for (const Color color : layout.colors()) {
    std::vector<int> channels;  // of 0, 45, 90, 135 degrees
    for (int angle = 0; angle < 180; angle += 45)
      for (int k = 0; k < n; ++k)
        if (layout.site(k).color == color && layout.site(k).angle_deg == angle)
          channels.push_back(k);
    if (channels.size() != 4) continue;
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t k = 0; k < 4; ++k) matrix(channels[i], channels[k]) = rows[i][k];
  }
  return matrix;
}

// What blocks are matched on: the components that are sums.
std::vector<float> intensity_weights(const Eigen::MatrixXd& matrix) {
  std::vector<float> weights;
  for (Eigen::Index i = 0; i < matrix.rows(); ++i)
    weights.push_back(matrix.row(i).sum() > 0.99 ? 1.0f : 0.0f);
  return weights;
}

// planes <- matrix * planes, channel-wise.
Planes mixed(const Planes& planes, const Eigen::MatrixXd& matrix) {
  Planes out(planes.channels(), planes.rows(), planes.cols());
  for (int a = 0; a < planes.channels(); ++a)
    for (int b = 0; b < planes.channels(); ++b)
      for (std::size_t i = 0; i < out[a].size(); ++i)
        out[a].values()[i] += static_cast<float>(matrix(a, b)) * planes[b].values()[i];
  return out;
}

// Principal components of the planes, each filtered alone; the planes' noise has deviation 1.
Planes filter_components(Planes planes, const Bm3dSettings& settings, Progress& progress) {
  const std::vector<float> sigma(static_cast<std::size_t>(planes.channels()), 1.0f);
  const Eigen::MatrixXd axes = principal_components(planes);
  planes = mixed(planes, axes.transpose());
  filter_each(planes, sigma, settings, progress);
  return mixed(planes, axes);
}

// The same with the planes of every alignment of cell and mosaic, averaged: pseudo-channel
// denoising (Akiyama, Tanaka, Okutomi, ICIP 2015; of polarization mosaics Abdul Rahman, Monno,
// Tanaka, Okutomi, arXiv 2509.10098). Planes of one deviation need none of its noise covariance,
// which would not turn their axes.
Planes filter_alignments(const Planes& planes, const SensorLayout& layout, int rows, int cols,
                         const Bm3dSettings& settings, Progress& progress) {
  Image mosaic(rows, cols), sum(rows, cols);
  unpack(planes, layout, mosaic);
  for (int i = 0; i < std::min(layout.rows(), rows); ++i)
    for (int k = 0; k < std::min(layout.cols(), cols); ++k) {
      const auto shifted = mosaic.view().window(i, k, rows - i, cols - k);
      Image estimate(rows - i, cols - k);
      unpack(filter_components(pack(shifted, layout), settings, progress), layout, estimate);
      for (int r = i; r < rows; ++r)
        for (int c = k; c < cols; ++c) sum(r, c) += estimate(r - i, c - k);
    }
  for (int r = 0; r < rows; ++r)  // alignments that reach the pixel
    for (int c = 0; c < cols; ++c)
      sum(r, c) /= static_cast<float>((std::min(r, layout.rows() - 1) + 1) *
                                      (std::min(c, layout.cols() - 1) + 1));
  return pack(sum, layout);
}

// Measured on frames of 5 and 60 megapixels: mosaic, result and planes, the planes' mixture, and
// what BM3D holds beside the planes that it filters at once.
double bytes_needed(const std::string& name, const PreparedFrame& frame) {
  constexpr double kFrames = 12, kMixed = 4, kAligned = 12, kFilter = 20;
  const bool joint = name == "paper-mbm3d" || name == "vst-stokes-bm3d";
  const bool mixes = name == "vst-pca-bm3d" || name == "vst-pfcd" || name == "vst-stokes-bm3d";
  std::size_t planes_at_once = 1;
  if (name == "paper-bm3d")
    for (const GreyPicture& p : grey_pictures(frame.layout))
      planes_at_once = std::max(planes_at_once, p.size());
  const double at_once =
      joint ? 1.0 : static_cast<double>(planes_at_once) / frame.layout.channels();
  const double aligned = name == "vst-pfcd" ? kAligned : 0.0;
  return (kFrames + (mixes ? kMixed : 0.0) + aligned + kFilter * at_once) *
         static_cast<double>(frame.dn.size());
}

}  // namespace

Image run_baseline(const std::string& name, const PreparedFrame& frame, const NoiseProfile& profile,
                   const DenoiseSettings& settings, Progress& progress) {
  const MemoryBudget memory{settings.memory_mib, settings.held_values};
  const double needed = bytes_needed(name, frame);
  if (needed > memory.bytes()) memory.refuse(needed, frame.dn.rows(), frame.dn.cols());
  Bm3dSettings bm3d_settings;
  bm3d_settings.profile = settings.profile;
  Planes planes = pack(frame.dn, frame.layout);
  const auto channels = static_cast<std::size_t>(planes.channels());
  std::vector<float> sigma(channels, 1.0f);
  if (name == "paper-bm3d") {
    filter_grey_pictures(planes, frame.layout, settings.strength, bm3d_settings, progress);
  } else if (name == "plane-bm3d" || name == "paper-mbm3d") {
    for (std::size_t k = 0; k < channels; ++k)
      sigma[k] =
          static_cast<float>(settings.strength * estimated_deviation(planes[static_cast<int>(k)]));
    if (name == "paper-mbm3d") {
      float mean = 0;
      for (const float s : sigma) mean += s / static_cast<float>(channels);
      std::fill(sigma.begin(), sigma.end(), mean);
      planes = bm3d(planes, sigma, bm3d_settings, {}, progress);
    } else {
      filter_each(planes, sigma, bm3d_settings, progress);
    }
  } else {
    const auto stabilizers = make_stabilizers(profile, frame.highest_dn, settings.strength);
    stabilise(planes, stabilizers, false);
    if (name == "vst-pca-bm3d") {
      planes = filter_components(std::move(planes), bm3d_settings, progress);
    } else if (name == "vst-pfcd") {
      planes = filter_alignments(planes, frame.layout, frame.dn.rows(), frame.dn.cols(),
                                 bm3d_settings, progress);
    } else if (name == "vst-stokes-bm3d") {
      const Eigen::MatrixXd matrix = stokes_components(frame.layout);
      planes =
          bm3d(mixed(planes, matrix), sigma, bm3d_settings, intensity_weights(matrix), progress);
      planes = mixed(planes, matrix.transpose());
    } else {
      MALUS_REQUIRE(name == "vst-bm3d");
      filter_each(planes, sigma, bm3d_settings, progress);
    }
    stabilise(planes, stabilizers, true);
  }
  Image mosaic(frame.dn.rows(), frame.dn.cols());
  unpack(planes, frame.layout, mosaic);
  return mosaic;
}

}  // namespace malus::internal
