#include "malus/noise/fixed_pattern.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/noise/model.h"
#include "malus/noise/profile.h"
#include "malus/noise/smooth_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace malus {
namespace {

double distance_db(const GainSetting& a, const GainSetting& b) {
  const auto x = a.decibel(), y = b.decibel();
  return x && y ? std::abs(*x - *y) : std::numeric_limits<double>::infinity();
}

// Beyond this many deviations of a map an outlier has little sampling error for its size.
constexpr double kOutlier = 4.0;

// Variance of a channel's values about the middle, without outliers: each pass leaves out what is
// one to the variance of the pass before.
std::vector<double> ordinary_variances(const Image& map, const SensorLayout& layout,
                                       double middle) {
  constexpr int kPasses = 3;
  const auto channels = static_cast<std::size_t>(layout.channels());
  std::vector<double> variance(channels, std::numeric_limits<double>::infinity());
  for (int pass = 0; pass < kPasses; ++pass) {
    std::vector<double> sum(channels, 0.0), count(channels, 0.0);
    for (int row = 0; row < map.rows(); ++row)
      for (int col = 0; col < map.cols(); ++col) {
        const auto c = static_cast<std::size_t>(layout.channel_at(row, col));
        const double square = (map(row, col) - middle) * (map(row, col) - middle);
        if (square > kOutlier * kOutlier * variance[c]) continue;
        sum[c] += square;
        ++count[c];
      }
    for (std::size_t c = 0; c < channels; ++c) variance[c] = count[c] > 0 ? sum[c] / count[c] : 0;
  }
  return variance;
}

// A map holds the sampling error of the frames that it was made of. It is drawn towards its middle
// by that error's share of the variance, as a Wiener filter would, but outliers by less: a column
// of weak response is as weak as it looks. Without that one share of the whole map fits either the
// many pixels or the outliers, and two parts of a frame contradict each other. Returns what is kept
// of the map: the factor by which the map as it was exceeds the result, to least squares, inverted.
double take_sampling_error_out(Image& map, const SensorLayout& layout, double middle,
                               const std::vector<double>& variance,
                               const std::vector<double>& error_variance) {
  double square = 0, product = 0;
  for (int row = 0; row < map.rows(); ++row)
    for (int col = 0; col < map.cols(); ++col) {
      const auto c = static_cast<std::size_t>(layout.channel_at(row, col));
      const double off = map(row, col) - middle,
                   scale = std::max(variance[c], off * off / (kOutlier * kOutlier)),
                   factor =
                       error_variance[c] > 0 ? std::max(1 - error_variance[c] / scale, 0.0) : 1;
      map(row, col) = static_cast<float>(middle + factor * off);
      square += factor * off * factor * off;
      product += factor * off * off;
    }
  return square > 0 ? square / product : 1;
}

// Of every channel's columns, about the middle; pixels far from the others of theirs, as hot ones
// are, take no part.
Image column_means(const Image& map, const SensorLayout& layout, double middle,
                   const std::vector<double>& variance) {
  Image means(layout.rows(), map.cols());
  parallel_for(0, map.cols(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    std::vector<double> pixels;
    for (int col = static_cast<int>(begin); col < end; ++col)
      for (int phase = 0; phase < layout.rows(); ++phase) {
        pixels.clear();
        for (int row = phase; row < map.rows(); row += layout.rows())
          pixels.push_back(map(row, col));
        const auto c = static_cast<std::size_t>(layout.channel_at(phase, col));
        const double median = median_of(pixels), far = kOutlier * std::sqrt(variance[c]);
        double sum = 0, count = 0;
        for (const double pixel : pixels)
          if (std::abs(pixel - median) <= far) sum += pixel - middle, ++count;
        means(phase, col) = static_cast<float>(count > 0 ? sum / count : median - middle);
      }
  });
  return means;
}

// Whether columns differ by more than their independent pixels would have it.
bool differ(const Image& columns, const SensorLayout& layout,
            const std::vector<double>& chance_variance) {
  constexpr double kChance = 5;  // in standard errors of a sum of as many squares of normal draws
  double squares = 0;
  for (int phase = 0; phase < columns.rows(); ++phase)
    for (int col = 0; col < columns.cols(); ++col) {
      const auto c = static_cast<std::size_t>(layout.channel_at(phase, col));
      const double square = double{columns(phase, col)} * columns(phase, col);
      if (square > 0) squares += square / chance_variance[c];
    }
  const auto count = static_cast<double>(columns.size());
  return squares / count > 1 + kChance * std::sqrt(2 / count);
}

// What columns share with the next four of their channel on either side (fewer towards an edge, as
// many on both): the median, which a weak column leaves as it is.
constexpr int kBeside = 4;

Image smooth_along_rows(const Image& columns, int period) {
  Image smooth(columns.rows(), columns.cols());
  for (int row = 0; row < columns.rows(); ++row)
    for (int col = 0; col < columns.cols(); ++col) {
      const int beside = std::min({kBeside, col / period, (columns.cols() - 1 - col) / period});
      std::vector<double> values;
      for (int k = -beside; k <= beside; ++k) values.push_back(columns(row, col + k * period));
      smooth(row, col) = static_cast<float>(median_of(std::move(values)));
    }
  return smooth;
}

// As take_sampling_error_out, of each by its own variance: what is smooth along the rows and what
// differs from it. Sampling error is in the second, and so is all that a frame is compared with. A
// glow's variance in that of the whole would keep the error: then frames, which do not have it,
// seem to hold less of the columns than they do, and of the glow less than all is taken out.
// Returns what is kept of the differences that frames are compared with.
double take_error_out_of_columns(Image& columns, const SensorLayout& layout,
                                 const std::vector<double>& error_variance) {
  constexpr int kColumns = 2 * kBeside + 1;
  constexpr double kOfMedian = 0.166;  // variance of the median of as many, of variance 1
  constexpr double kOfRest = 1 - 2.0 / kColumns + kOfMedian;
  const Image before = columns;
  const int period = layout.cols();
  const auto draw = [&](Image& part, double share) {
    std::vector<double> error = error_variance;
    for (double& e : error) e *= share;
    take_sampling_error_out(part, layout, 0, ordinary_variances(part, layout, 0), error);
  };
  Image smooth = smooth_along_rows(columns, period);
  for (std::size_t i = 0; i < columns.size(); ++i) columns.values()[i] -= smooth.values()[i];
  draw(smooth, kOfMedian);
  draw(columns, kOfRest);
  for (std::size_t i = 0; i < columns.size(); ++i) columns.values()[i] += smooth.values()[i];
  double square = 0, product = 0;
  for (int row = 0; row < columns.rows(); ++row)
    for (int col = period; col + period < columns.cols(); ++col) {
      const auto stands_out = [&](const Image& map) {
        return map(row, col) - 0.5 * (double{map(row, col - period)} + map(row, col + period));
      };
      square += stands_out(columns) * stands_out(columns);
      product += stands_out(columns) * stands_out(before);
    }
  return square < product ? square / product : 1;
}

// A map, and the part of it that whole columns have in common.
struct Parts {
  Image map, columns;
  double kept = 1, columns_kept = 1;
  FixedPattern::Shares shares;
};

// Variances, per channel, that a map has of what the frames left in it; empty: not known.
struct MapError {
  std::vector<double> pixels, columns, rows;  // a pixel's own; its column's; its rows'
};

double mean_square(const Image& values) {
  double sum = 0;
  for (const float v : values.values()) sum += double{v} * v;
  return values.empty() ? 0 : sum / static_cast<double>(values.size());
}

// Of every channel, the variance of a pixel that differs from its neighbours in the row as these
// do: without what is smooth, and as frames are compared with the map.
std::vector<double> variances_of_differences(const Image& map, const SensorLayout& layout) {
  constexpr double kOfDifference = 1.5;  // the pixel's own, and half of a neighbour's
  const int period = layout.cols();
  if (map.cols() <= 3 * period) return ordinary_variances(map, layout, 0);
  Image differences(map.rows(), map.cols() - 2 * period);
  for (int row = 0; row < map.rows(); ++row)
    for (int col = 0; col < differences.cols(); ++col)
      differences(row, col) =
          map(row, col + period) - 0.5F * (map(row, col) + map(row, col + 2 * period));
  std::vector<double> variance = ordinary_variances(differences, layout, 0);
  for (double& v : variance) v /= kOfDifference;
  return variance;
}

// What is smooth in both directions, taken out of the map, and out of `error` what it had of that.
// Frames are compared with the rest alone: a glow's variance in that of the pixels would keep their
// error, frames would seem to hold less than all, and that much of the glow would stay.
Image take_smooth_out(Image& map, const SensorLayout& layout, double middle, const MapError& known,
                      const std::vector<double>& variance, std::vector<double>& error) {
  if (known.rows.size() != error.size()) return {};
  const SmoothMap smooth(map, layout.rows(), layout.cols(), middle);
  std::vector<double> chance = known.rows, of_smooth = known.rows;
  for (std::size_t c = 0; c < error.size(); ++c) chance[c] += SmoothMap::kOfMedian * variance[c];
  if (!smooth.differs(chance)) return {};
  if (known.pixels.size() == error.size()) error = known.pixels;
  for (std::size_t c = 0; c < error.size(); ++c) of_smooth[c] += SmoothMap::kOfMedian * error[c];
  Image values = smooth.values();
  for (std::size_t i = 0; i < map.size(); ++i) map.values()[i] -= values.values()[i];
  take_sampling_error_out(values, layout, 0, ordinary_variances(values, layout, 0), of_smooth);
  return values;
}

Parts parts_of(Image map, const SensorLayout& layout, double middle,
               const std::vector<double>& pattern_sd, const MapError& known) {
  const auto channels = static_cast<std::size_t>(layout.channels());
  Parts parts{std::move(map), {}, 1, 1, {}};
  if (parts.map.empty() || pattern_sd.size() != channels) return parts;
  std::vector<double> variance = ordinary_variances(parts.map, layout, middle), error(channels),
                      chance(channels), of_columns(channels);
  const double pixels = parts.map.rows() / layout.rows();
  for (std::size_t c = 0; c < channels; ++c) {
    const double lines = known.columns.size() == channels ? known.columns[c] : 0;
    error[c] = std::max(variance[c] - pattern_sd[c] * pattern_sd[c], 0.0);
    chance[c] = variance[c] / pixels + lines;
    of_columns[c] = error[c] / pixels + lines;
  }
  Image columns = column_means(parts.map, layout, middle, variance);
  if (differ(columns, layout, chance)) {
    for (int row = 0; row < parts.map.rows(); ++row)
      for (int col = 0; col < parts.map.cols(); ++col)
        parts.map(row, col) -= columns(row % layout.rows(), col);
    variance = ordinary_variances(parts.map, layout, middle);
    for (std::size_t c = 0; c < channels; ++c) error[c] = std::max(error[c] - of_columns[c], 0.0);
    parts.columns_kept = take_error_out_of_columns(columns, layout, of_columns);
    parts.columns = std::move(columns);
  }
  const Image smooth = take_smooth_out(parts.map, layout, middle, known, variance, error);
  if (!smooth.empty()) variance = variances_of_differences(parts.map, layout);
  parts.kept = take_sampling_error_out(parts.map, layout, middle, variance, error);
  const double of_lines = mean_square(parts.columns), of_smooth = mean_square(smooth);
  double of_pixels = 0;
  for (std::size_t c = 0; c < channels; ++c)
    of_pixels += std::max(variance[c] - error[c], 0.0) / static_cast<double>(channels);
  if (const double all = of_pixels + of_lines + of_smooth; of_lines + of_smooth > 0 && all > 0)
    parts.shares = {of_lines / all, of_smooth / all};
  if (!smooth.empty())
    for (std::size_t i = 0; i < smooth.size(); ++i) parts.map.values()[i] += smooth.values()[i];
  return parts;
}

// Field: a map, or a list of one value per channel.
template <class Field>
const PhysicsCalibration* nearest_with(const NoiseModel& model, const GainSetting& gain,
                                       Field PhysicsCalibration::*field) {
  const PhysicsCalibration* nearest = nullptr;
  for (const PhysicsCalibration& p : model.physics)
    if (!(p.*field).empty() &&
        (!nearest || distance_db(p.gain, gain) < distance_db(nearest->gain, gain)))
      nearest = &p;
  return nearest;
}

// Defects, which are told by their place, count as ordinary pixels.
Parts nearest_map(const NoiseModel& model, const PhysicsCalibration& nearest,
                  Image PhysicsCalibration::*map,
                  std::vector<double> PhysicsCalibration::*pattern_sd, const MapError& error,
                  float ordinary) {
  const auto without_defects = [&](Image& copy) {
    for (const DefectPixel& defect : model.defects) {
      MALUS_REQUIRE(defect.row < copy.rows() && defect.col < copy.cols());  // contradiction_in
      copy(defect.row, defect.col) = ordinary;
    }
  };
  Image copy = nearest.*map;
  without_defects(copy);
  Parts parts = parts_of(std::move(copy), model.layout, ordinary, nearest.*pattern_sd, error);
  without_defects(parts.map);
  return parts;
}

// Noise of the bias frames that is left in their mean. Rows: in the median of a block of them.
MapError error_of_dark(const NoiseModel& model, const PhysicsCalibration& dark) {
  const double frames = std::max(dark.bias_frames, 1),
               in_group = std::max(model.row_group / model.layout.rows(), 1),
               groups = std::max(SmoothMap::kBlock / in_group, 1.0);
  MapError error{dark.temporal_sd_dark_dn, dark.sigma_column.mean, dark.sigma_row.mean};
  const auto square_of = [](const std::vector<double>& deviation, std::size_t c) {
    return c < deviation.size() ? deviation[c] * deviation[c] : 0;
  };
  for (std::size_t c = 0; c < error.pixels.size(); ++c)
    error.pixels[c] = std::max(square_of(error.pixels, c) - square_of(error.columns, c) -
                                   square_of(error.rows, c),
                               0.0) /
                      frames;
  for (double& v : error.columns) v = v * v / frames;
  for (double& v : error.rows) v = v * v / frames / groups;
  return error;
}

}  // namespace

std::shared_ptr<const FixedPattern> fixed_pattern_at(const NoiseModel& model,
                                                     const GainSetting& gain) {
  const auto *dark = nearest_with(model, gain, &PhysicsCalibration::dark_shading_dn),
             *response = nearest_with(model, gain, &PhysicsCalibration::prnu_map);
  if (!dark && !response) return nullptr;
  FixedPattern pattern;
  if (dark) {
    Parts parts = nearest_map(model, *dark, &PhysicsCalibration::dark_shading_dn,
                              &PhysicsCalibration::dsnu_dn, error_of_dark(model, *dark), 0);
    pattern.dark_dn = std::move(parts.map);
    pattern.dark_columns_dn = std::move(parts.columns);
    pattern.dark_kept = parts.kept;
    pattern.dark_columns_kept = parts.columns_kept;
    pattern.dark_shares = parts.shares;
  }
  if (response) {
    Parts parts = nearest_map(model, *response, &PhysicsCalibration::prnu_map,
                              &PhysicsCalibration::prnu, {}, 1);
    pattern.response = std::move(parts.map);
    pattern.response_columns = std::move(parts.columns);
    pattern.response_kept = parts.kept;
    pattern.response_columns_kept = parts.columns_kept;
    pattern.response_shares = parts.shares;
  }
  return std::make_shared<const FixedPattern>(std::move(pattern));
}

std::vector<PatternDeviation> pattern_deviations_at(const NoiseModel& model,
                                                    const GainSetting& gain,
                                                    const NoiseProfile& profile) {
  const auto *dark = nearest_with(model, gain, &PhysicsCalibration::dsnu_dn),
             *response = nearest_with(model, gain, &PhysicsCalibration::prnu);
  const auto known = [](double value) { return std::isfinite(value) ? std::max(value, 0.0) : 0.0; };
  std::vector<PatternDeviation> deviations(profile.channels.size());
  for (std::size_t c = 0; c < deviations.size(); ++c) {
    if (response) deviations[c].prnu = known(response->prnu[c]);
    if (!dark) continue;
    const double K = dark->K.mean.empty() ? 0 : dark->K.mean[c],
                 K_here = profile.channels[c].gain_dn_per_e;
    deviations[c].dsnu_dn = known(dark->dsnu_dn[c]) * (K > 0 && K_here > 0 ? K_here / K : 1);
  }
  return deviations;
}

void add_pattern_noise(NoiseProfile& profile, const std::vector<PatternDeviation>& deviations) {
  MALUS_REQUIRE(deviations.size() == profile.channels.size());
  for (std::size_t c = 0; c < deviations.size(); ++c) {
    const auto [prnu, dsnu_dn] = deviations[c];
    ChannelProfile& channel = profile.channels[c];
    channel.variance = channel.variance.with_pattern(prnu, dsnu_dn);
    if (channel.law) channel.law = channel.law->with_pattern(prnu, dsnu_dn);
  }
}

double map_values(const NoiseModel& model) {
  double values = 0;
  for (const PhysicsCalibration& p : model.physics)
    values += static_cast<double>(p.dark_shading_dn.size() + p.prnu_map.size());
  return values;
}

void drop_maps(NoiseModel& model) {
  for (PhysicsCalibration& p : model.physics) p.dark_shading_dn = p.prnu_map = Image();
}

}  // namespace malus
