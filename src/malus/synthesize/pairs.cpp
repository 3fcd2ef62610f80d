#include "malus/synthesize/pairs.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/text.h"
#include "malus/noise/raw_variance.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kFewestPixels = 100;

struct Products {
  double cross = 0, square = 0;
  std::int64_t pixels = 0;
};

// From here on white may have cut off some of the frames that a reference is the mean of.
float clipped_from(double white_dn) {
  constexpr float kNearWhite = 0.98f;
  return kNearWhite * static_cast<float>(white_dn);
}

// 0 where the profile does not hold it.
double mean_gain_dn_per_e(const NoiseProfile& profile) {
  double sum = 0;
  for (const ChannelProfile& channel : profile.channels) sum += channel.gain_dn_per_e;
  return sum / static_cast<double>(profile.channels.size());
}

}  // namespace

Estimate<double> relative_intensity(View<const float> short_dn, View<const float> reference_dn,
                                    double low_dn, double high_dn) {
  MALUS_REQUIRE(short_dn.rows() == reference_dn.rows() && short_dn.cols() == reference_dn.cols());
  const auto of_rows = [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    Products sums;
    for (int r = static_cast<int>(begin); r < end; ++r)
      for (int c = 0; c < short_dn.cols(); ++c) {
        const double x = static_cast<double>(reference_dn(r, c));
        const double y = static_cast<double>(short_dn(r, c));
        if (!(x > low_dn && x < high_dn && std::isfinite(y))) continue;
        sums.cross += x * y;
        sums.square += x * x;
        ++sums.pixels;
      }
    return sums;
  };
  const auto add = [](Products a, const Products& b) {
    return Products{a.cross + b.cross, a.square + b.square, a.pixels + b.pixels};
  };
  const Products total = parallel_reduce(0, short_dn.rows(), 16, Products{}, of_rows, add);
  if (total.pixels < kFewestPixels || total.square <= 0)
    return Undecided{fmt::format("{} of the reference between {:.4g} and {:.4g} DN, {} are needed",
                                 counted(total.pixels, "pixel"), low_dn, high_dn, kFewestPixels)};
  return total.cross / total.square;
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

NearestFrame nearest_frame(const std::vector<double>& intensities, double ratio) {
  MALUS_REQUIRE(!intensities.empty() && ratio > 0);
  NearestFrame nearest;
  double sum = 0;
  for (std::size_t i = 0; i < intensities.size(); ++i) {
    sum += intensities[i];
    const double deviation = intensities[i] * ratio - 1.0;
    if (i == 0 || std::abs(deviation) < std::abs(nearest.deviation)) {
      nearest.index = i;
      nearest.deviation = deviation;
    }
  }
  const auto [low, high] = std::minmax_element(intensities.begin(), intensities.end());
  const double mean = sum / static_cast<double>(intensities.size());
  if (mean > 0) nearest.flicker = (*high - *low) / mean;
  return nearest;
}

}  // namespace malus
