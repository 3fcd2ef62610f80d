#include "malus/synthesize/pairs.h"

#include "malus/base/error.h"
#include "malus/base/normal_distribution.h"
#include "malus/base/parallel.h"
#include "malus/base/text.h"
#include "malus/noise/raw_variance.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kFewestPixels = 100;

// Rows of a band: those that are read out together share their row noise.
constexpr int kBandRows = 4;

struct Products {
  double cross = 0, square = 0;
  std::int64_t pixels = 0;

  void add(const Products& other) {
    cross += other.cross;
    square += other.square;
    pixels += other.pixels;
  }
};

// From here on white may have cut off some of the frames that a reference is the mean of.
float clipped_from(double white_dn) {
  constexpr float kNearWhite = 0.98f;
  return kNearWhite * static_cast<float>(white_dn);
}

// Of an intensity, by noise, from so many degrees of freedom.
struct NoiseOfLight {
  double standard_error, freedom;
};

// The bands of all candidates show the same scene, and their fixed patterns stay the same, too:
// what a band differs by from its mean over the candidates is noise.
std::optional<NoiseOfLight> noise_of(const std::vector<RelativeIntensity>& intensities) {
  const auto frames = static_cast<double>(intensities.size());
  const std::size_t bands = intensities.front().of_bands.size();
  if (frames < 2 || bands < 2) return std::nullopt;
  double squares = 0;
  for (std::size_t b = 0; b < bands; ++b) {
    double mean = 0;
    for (const RelativeIntensity& one : intensities) mean += one.of_bands[b] / frames;
    for (const RelativeIntensity& one : intensities) squares += std::pow(one.of_bands[b] - mean, 2);
  }
  // The sum over a frame's bands is 0 by its intensity, which takes one band's part.
  const auto free_bands = static_cast<double>(bands - 1);
  const double of_sum = static_cast<double>(bands) / free_bands;
  return NoiseOfLight{std::sqrt(squares * of_sum / (frames - 1)), free_bands * (frames - 1)};
}

// Standard errors of the difference of two that the largest one among several exceeds as rarely as
// that of two exceeds three; of an error from few degrees of freedom more, by Student's t
// distribution (Cornish and Fisher's first term).
double deviations_of_range(std::size_t frames, double freedom) {
  const double pairs = static_cast<double>(frames) * static_cast<double>(frames - 1) / 2;
  double deviations = 3;
  while (normal_cdf(-deviations) * pairs > normal_cdf(-3)) deviations += 0.01;
  return deviations + (std::pow(deviations, 3) + deviations) / (4 * freedom);
}

// 0 where the profile does not hold it.
double mean_gain_dn_per_e(const NoiseProfile& profile) {
  double sum = 0;
  for (const ChannelProfile& channel : profile.channels) sum += channel.gain_dn_per_e;
  return sum / static_cast<double>(profile.channels.size());
}

}  // namespace

Estimate<RelativeIntensity> relative_intensity(View<const float> short_dn,
                                               View<const float> reference_dn, double low_dn,
                                               double high_dn) {
  MALUS_REQUIRE(short_dn.rows() == reference_dn.rows() && short_dn.cols() == reference_dn.cols());
  const auto of_rows = [&](int begin, int end) {
    Products sums;
    for (int r = begin; r < end; ++r)
      for (int c = 0; c < short_dn.cols(); ++c) {
        const double x = static_cast<double>(reference_dn(r, c));
        const double y = static_cast<double>(short_dn(r, c));
        if (!(x > low_dn && x < high_dn && std::isfinite(y))) continue;
        sums.add({x * y, x * x, 1});
      }
    return sums;
  };
  const int rows = short_dn.rows();
  std::vector<Products> bands(static_cast<std::size_t>((rows + kBandRows - 1) / kBandRows));
  parallel_for(0, std::ssize(bands), 4, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
      bands[static_cast<std::size_t>(i)] =
          of_rows(i * kBandRows, std::min((i + 1) * kBandRows, rows));
  });
  Products total;
  for (const Products& band : bands) total.add(band);
  if (total.pixels < kFewestPixels || total.square <= 0)
    return Undecided{fmt::format("{} of the reference between {:.4g} and {:.4g} DN, {} are needed",
                                 counted(total.pixels, "pixel"), low_dn, high_dn, kFewestPixels)};
  RelativeIntensity found{total.cross / total.square};
  for (const Products& band : bands)
    found.of_bands.push_back((band.cross - found.value * band.square) / total.square);
  return found;
}

double clipped_share(View<const float> reference_dn, double white_dn) {
  const float top = clipped_from(white_dn);
  std::int64_t clipped = 0, pixels = 0;
  for (int r = 0; r < reference_dn.rows(); ++r)
    for (int c = 0; c < reference_dn.cols(); ++c) {
      clipped += reference_dn(r, c) >= top;
      ++pixels;
    }
  return static_cast<double>(clipped) / static_cast<double>(pixels);
}

std::optional<double> white_of_reference(const RawFrame& reference, const RawFrame& short_frame) {
  for (const RawFrame* frame : {&reference, &short_frame})
    if (frame->white_known) return white_above_black(frame->white_dn, frame->black_dn);
  return std::nullopt;
}

double white_of_reference(const RawFrame& reference, double camera_white_above_black_dn) {
  return white_of_reference(reference, RawFrame()).value_or(camera_white_above_black_dn);
}

double white_of_reference(const RawFrame& reference, const RawFrame& short_frame,
                          const NoiseModel& model) {
  return white_of_reference(reference, short_frame)
      .value_or(white_above_black(model.white_dn, model.black_dn));
}

std::int64_t mark_unknown(Image& reference_dn, double white_dn, const DefectList& defects) {
  constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();
  if (defects.rows == reference_dn.rows() && defects.cols == reference_dn.cols())
    for (const DefectList::Place& place : defects.places)
      reference_dn(place.row, place.col) = kUnknown;
  const float top = clipped_from(white_dn);
  std::int64_t unknown = 0;
  for (float& v : reference_dn.values()) {
    if (v >= top) v = kUnknown;
    unknown += !std::isfinite(v);
  }
  return unknown;
}

void KnownGains::require(const GainSetting& gain, const std::string& of) {
  if (std::ranges::find(known_, gain) != known_.end()) return;
  try {
    (void)model_.profile_at(gain, range_);
  } catch (const InputError& error) {
    throw InputError(fmt::format("{} at {}", of, gain.text()), error.problem(),
                     "give a model that knows this gain, or leave the pair out");
  }
  known_.push_back(gain);
}

Image light_of_reference(Image reference_dn, double ratio, const NoiseModel* model,
                         const std::optional<GainSetting>& bias_at, GainRange range) {
  MALUS_REQUIRE(ratio > 0);
  if (model && bias_at) subtract_bias(reference_dn, model->profile_at(*bias_at, range));
  for (float& v : reference_dn.values()) v = static_cast<float>(static_cast<double>(v) / ratio);
  return reference_dn;
}

std::optional<double> gain_ratio(const NoiseProfile& one, const NoiseProfile& other) {
  const double above = mean_gain_dn_per_e(one), below = mean_gain_dn_per_e(other);
  if (!(above > 0 && below > 0)) return std::nullopt;
  return above / below;
}

double gain_ratio(const GainSetting& one, const GainSetting& other) {
  const auto above_db = one.decibel(), below_db = other.decibel();
  return above_db && below_db ? std::pow(10.0, (*above_db - *below_db) / 20.0) : 1.0;
}

NearestFrame nearest_frame(const std::vector<RelativeIntensity>& intensities, double ratio) {
  MALUS_REQUIRE(!intensities.empty() && ratio > 0);
  NearestFrame nearest;
  double sum = 0, low = intensities.front().value, high = low;
  for (std::size_t i = 0; i < intensities.size(); ++i) {
    const double value = intensities[i].value, deviation = value * ratio - 1.0;
    sum += value;
    low = std::min(low, value);
    high = std::max(high, value);
    if (i == 0 || std::abs(deviation) < std::abs(nearest.deviation)) {
      nearest.index = i;
      nearest.deviation = deviation;
    }
  }
  const double mean = sum / static_cast<double>(intensities.size());
  const auto noise = noise_of(intensities);
  if (!(mean > 0) || !noise) return nearest;
  nearest.flicker_of_noise = deviations_of_range(intensities.size(), noise->freedom) *
                             std::numbers::sqrt2 * noise->standard_error / mean;
  const double flicker = (high - low) / mean;
  if (flicker > *nearest.flicker_of_noise) nearest.flicker = flicker;
  return nearest;
}

}  // namespace malus
