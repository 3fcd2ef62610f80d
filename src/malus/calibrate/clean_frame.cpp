#include "malus/calibrate/clean_frame.h"

#include "malus/base/index.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus {
namespace {

// Visits the pixels of one channel in rows begin to end.
template <class Use>
void for_pixels(const MosaicGeometry& geometry, int channel, int begin, int end, const Use& use) {
  for (int r = begin; r < end; ++r) {
    if (r % geometry.cell_rows() != channel / geometry.cell_cols()) continue;
    for (int c = channel % geometry.cell_cols(); c < geometry.cols(); c += geometry.cell_cols())
      use(r, c);
  }
}
// use(row group, its first row, the row after its last, the channel's pixels in it), where there
// are two or more.
template <class Use>
void for_groups(const MosaicGeometry& geometry, int channel, const Use& use) {
  const int height = geometry.row_group();
  for (int group = 0; group < geometry.groups(); ++group)
    if (const int n = geometry.group_pixels(group, channel); n >= 2)
      use(group, group * height, std::min((group + 1) * height, geometry.rows()), n);
}

// Row noise of frames of one scene: what the means of row groups vary by from frame to frame. The
// lamp is brought to the first frame's.
class GroupMeans {
 public:
  GroupMeans(const MosaicGeometry& geometry, const std::vector<double>& dark_dn)
      : geometry_(geometry),
        dark_dn_(dark_dn),
        means_(dark_dn.size(), std::vector<Moments>(as_index(geometry.groups()))) {}

  void add(View<const float> dn) {
    std::vector<double> light = channel_means(dn, geometry_);
    for (std::size_t c = 0; c < light.size(); ++c) light[c] -= dark_dn_[c];
    if (first_.empty()) first_ = light;
    for (int channel = 0; channel < geometry_.channels(); ++channel) {
      const auto i = as_index(channel);
      const double lamp = first_[i] > 0 && light[i] > 0 ? first_[i] / light[i] : 1.0;
      for_groups(geometry_, channel, [&](int group, int begin, int end, int n) {
        double sum = 0;
        for_pixels(geometry_, channel, begin, end,
                   [&](int r, int c) { sum += dn(r, c) - dark_dn_[i]; });
        means_[i][as_index(group)].add(lamp * sum / n);
      });
    }
  }
  /// σ_b²; pixel_dn2: mean temporal variance of a pixel, rows included.
  double row_variance_dn2(int channel, double pixel_dn2) const {
    Moments row;
    for_groups(geometry_, channel, [&](int group, int, int, int n) {
      // The mean of a group varies by σ_b² + v/n, a pixel by σ_b² + v.
      row.add((means_[as_index(channel)][as_index(group)].variance() - pixel_dn2 / n) /
              (1.0 - 1.0 / n));
    });
    return row.count() > 0 ? std::max(row.mean(), 0.0) : 0.0;
  }

 private:
  const MosaicGeometry& geometry_;
  const std::vector<double>& dark_dn_;
  std::vector<double> first_;
  std::vector<std::vector<Moments>> means_;  ///< [channel][group]
};

// The line through the frames' mean over the reference.
struct ReferenceLine {
  double slope = 0, intercept = 0;
};

ReferenceLine reference_line(const Image& reference_dn, const Image& mean_dn,
                             const MosaicGeometry& geometry, int channel) {
  double n = 0, x = 0, y = 0, xx = 0, xy = 0;
  for_channel(geometry, channel, [&](int, int, int r, int c) {
    const double u = reference_dn(r, c), v = mean_dn(r, c);
    n += 1;
    x += u;
    y += v;
    xx += u * u;
    xy += u * v;
  });
  const double spread = xx - x * x / n;
  const double slope = spread > 0 ? (xy - x * y / n) / spread : (x > 0 ? y / x : 0.0);
  return {slope, (y - slope * x) / n};
}

// Pixels of like signal, equally many in each class: what weight the reference has among them.
class SignalClasses {
 public:
  SignalClasses(const Image& light_dn, const MosaicGeometry& geometry, int channel) {
    constexpr std::int64_t kPixels = 500, kMost = 64;
    const std::int64_t pixels = geometry.channel_pixels(channel), step = 1 + pixels / 50000;
    std::vector<float> light;
    std::int64_t index = 0;
    for_channel(geometry, channel, [&](int, int, int r, int c) {
      if (index++ % step == 0) light.push_back(light_dn(r, c));
    });
    std::sort(light.begin(), light.end());
    const std::int64_t classes = std::clamp<std::int64_t>(pixels / kPixels, 1, kMost);
    for (std::int64_t k = 1; k < classes; ++k)
      ends_.push_back(light[light.size() * static_cast<std::size_t>(k) / as_index(classes)]);
    of_.resize(as_index(classes));
  }
  struct Class {
    double pixels = 0, temporal_dn2 = 0, difference_dn2 = 0;
    double weight = 0, kept = 1;
  };
  Class& at(float light_dn) {
    return of_[as_index(std::lower_bound(ends_.begin(), ends_.end(), light_dn) - ends_.begin())];
  }
  // x - m and m - ref are independent: with the weight w of the reference, noisy - clean has the
  // variance v (1 - 1/N) + w² D, D that of m - ref, and clean is best where w is v/N over D.
  void weigh(double row_variance_dn2, int frames) {
    for (Class& c : of_) {
      c.kept = 1.0 - 1.0 / frames;
      const double v = c.temporal_dn2 / c.pixels - row_variance_dn2,
                   difference = c.difference_dn2 / c.pixels;
      if (!(v > 0)) continue;
      c.weight = difference > v / frames ? v / frames / difference : 1.0;
      c.kept += c.weight * c.weight * std::max(difference, 0.0) / v;
    }
  }

 private:
  std::vector<float> ends_;
  std::vector<Class> of_;
};

// Reference minus the frames' mean without what their rows have in common, and the square that each
// pixel's own part has.
struct Difference {
  Image dn, square_dn2;
};

void subtract_rows(const MosaicGeometry& geometry, int channel, Difference& difference) {
  for_groups(geometry, channel, [&](int, int begin, int end, int n) {
    double sum = 0, square = 0;
    for_pixels(geometry, channel, begin, end, [&](int r, int c) {
      sum += difference.dn(r, c);
      square += double{difference.dn(r, c)} * difference.dn(r, c);
    });
    const double mean = sum / n, variance = (square - n * mean * mean) / (n - 1);
    for_pixels(geometry, channel, begin, end, [&](int r, int c) {
      const double own = difference.dn(r, c) - mean;
      difference.dn(r, c) = static_cast<float>(own);
      difference.square_dn2(r, c) = static_cast<float>(own_square(own, variance, n));
    });
  });
}

// clean.light_dn, the frames' mean, becomes its average with the reference; temporal: of the
// frames, whose mean is released.
void add_reference(const Image& reference_dn, const TemporalAccumulator& temporal,
                   const GroupMeans& rows, bool dark_measured, const MosaicGeometry& geometry,
                   CleanFrame& clean) {
  const std::vector<double> variance = temporal.variance_dn2();
  Difference difference{Image(geometry.rows(), geometry.cols()),
                        Image(geometry.rows(), geometry.cols())};
  clean.pixel_kept = Image(geometry.rows(), geometry.cols());
  Image& light = clean.light_dn;
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    const auto i = as_index(channel);
    const ReferenceLine line = reference_line(reference_dn, light, geometry, channel);
    // The intercept is dark bias that black subtraction left: the frames', which belongs to the
    // noise, unless that is known; then it is the reference's.
    const double bias = dark_measured ? 0.0 : line.intercept;
    for_channel(geometry, channel, [&](int, int, int r, int c) {
      difference.dn(r, c) =
          static_cast<float>(line.slope * reference_dn(r, c) + line.intercept) - light(r, c);
      light(r, c) -= static_cast<float>(bias);
    });
    subtract_rows(geometry, channel, difference);
    SignalClasses classes(light, geometry, channel);
    // Sums of squares are about a mean with the first frame's lamp.
    const double first = temporal.frame_means_dn().front()[i], mean = clean.frame_mean_dn[i];
    const double lamp = first > 0 && mean > 0 ? std::pow(mean / first, 2) : 1.0;
    for_channel(geometry, channel, [&](int, int, int r, int c) {
      SignalClasses::Class& like = classes.at(light(r, c));
      like.pixels += 1;
      like.temporal_dn2 += lamp * temporal.sum_of_squares()(r, c) / (temporal.frames() - 1);
      like.difference_dn2 += difference.square_dn2(r, c);
    });
    classes.weigh(lamp * rows.row_variance_dn2(channel, variance[i] / lamp), temporal.frames());
    for_channel(geometry, channel, [&](int, int, int r, int c) {
      const SignalClasses::Class& like = classes.at(light(r, c));
      clean.pixel_kept(r, c) = static_cast<float>(like.kept);
      light(r, c) += static_cast<float>(like.weight * difference.dn(r, c));
    });
  }
}

// Variance in the darkest twentieth of each channel and its rise to the mean: what the bins of the
// histograms have to suit.
void measure_range(const TemporalAccumulator& temporal, const MosaicGeometry& geometry,
                   CleanFrame& clean) {
  const std::vector<double> variance = temporal.variance_dn2();
  for (int channel = 0; channel < geometry.channels(); ++channel) {
    std::vector<std::pair<float, float>> light_and_squares;
    const std::int64_t step = 1 + geometry.channel_pixels(channel) / 50000;
    std::int64_t index = 0;
    for_channel(geometry, channel, [&](int, int, int row, int col) {
      if (index++ % step == 0)
        light_and_squares.emplace_back(clean.light_dn(row, col),
                                       temporal.sum_of_squares()(row, col));
    });
    const auto darkest = static_cast<std::ptrdiff_t>(light_and_squares.size() / 20 + 1);
    std::nth_element(light_and_squares.begin(), light_and_squares.begin() + darkest - 1,
                     light_and_squares.end());
    double light = 0, squares = 0;
    for (std::ptrdiff_t i = 0; i < darkest; ++i) {
      light += light_and_squares[static_cast<std::size_t>(i)].first;
      squares += light_and_squares[static_cast<std::size_t>(i)].second;
    }
    const auto n = static_cast<double>(darkest);
    const double dark = squares / n / (temporal.frames() - 1.0), all = variance[as_index(channel)];
    const double rise = clean.frame_mean_dn[as_index(channel)] - light / n;
    clean.dark_variance_dn2.push_back(dark);
    // On a flat field there is no rise to see: all of the variance may be shot noise.
    const double mean = std::max(clean.frame_mean_dn[as_index(channel)], 1e-6);
    clean.slope_dn.push_back(rise > 0.2 * mean && all > dark ? (all - dark) / rise : all / mean);
  }
}

}  // namespace

CleanFrame measure_clean(const NoiseSource& source, const FrameFormat& format,
                         const MosaicGeometry& geometry, const DarkLevel& dark,
                         Progress& progress) {
  const FrameAlignment alignment = source.frames->kind == FrameKind::kBias
                                       ? FrameAlignment::kAdditive
                                       : FrameAlignment::kMultiplicative;
  TemporalAccumulator temporal(geometry, dark.dn, alignment);
  GroupMeans rows(geometry, dark.dn);
  for_each_frame(*source.frames, &format, progress, [&](const RawFrame& frame, int) {
    temporal.add(frame.dn);
    if (source.reference) rows.add(frame.dn);
  });
  CleanFrame clean;
  clean.rows_kept = 1.0 - 1.0 / source.frames->count;
  clean.frame_mean_dn = temporal.mean_dn();
  clean.light_dn = temporal.release_mean_frame_dn();
  measure_range(temporal, geometry, clean);
  if (source.reference) {
    TemporalAccumulator reference(geometry, format.black_dn, FrameAlignment::kMultiplicative);
    for_each_frame(*source.reference, &format, progress,
                   [&](const RawFrame& frame, int) { reference.add(frame.dn); });
    add_reference(reference.release_mean_frame_dn(), temporal, rows, dark.measured, geometry,
                  clean);
  }
  if (source.frames->kind == FrameKind::kBias) clean.frame_mean_dn.clear();
  return clean;
}

}  // namespace malus
