// What a frame itself tells of its row noise: its deviation and row group.
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/denoise/internal/row_evidence.h"
#include "malus/denoise/row_noise.h"
#include "malus/image/pack.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>

namespace malus {
namespace {

constexpr std::size_t kLeastRows = 64;  // for the deviation to be estimated from a picture
// A camera's rows differ by no more than this many deviations of its pixels: blinds and stripes do.
constexpr double kMostRowDeviation = 2.0;
// The unit, in deviations of the pixels, that a picture's own row noise is measured in.
constexpr double kEvidenceUnit = 0.25;
// Deviations at which a pixel has no influence on where most of its row lies: in doubt it is
// text's.
constexpr double kDoubtfulReach = 3.5;
// Rows 2k and 2k+1 that share their draws differ by so much less than 2k+1 and 2k+2, squared; and
// by more than this many errors of what chance makes of few rows, for the half of every offset
// stays where two draws are taken for one.
constexpr double kPairedRows = 0.64, kErrorsOfPairs = 3.0;
// A difference is compared with those beside it, so they are correlated by -2/3 and those after the
// next by 1/6: the variance of their mean square grows by 1 + 2 (4/9 + 1/36) (Bartlett, 1946).
constexpr double kOfNeighbours = 1.94;

// Offsets that repeat after this many rows or more agree by kRepeats over the root of their number:
// five deviations of what chance gives, for neighbouring comparisons share rows (Bartlett, 1946).
constexpr std::size_t kLeastPeriod = 9;
constexpr double kRepeats = 7.0;

// Second differences of neighbouring rows, what pixel noise and picture explain of their variance,
// and how the differences of rows 2k, 2k+1 and of rows 2k+1, 2k+2 differ.
struct DifferencesOfRows {
  std::vector<int> row;
  std::vector<double> value, explained, texture, within, across;
};

// How many cells apart rows of one channel share no draw where `rows` of them may do so.
int cells_apart(const NoiseProfile& profile, int rows) {
  return packed_size(rows, profile.layout.rows());
}

DifferencesOfRows differences_of_rows(View<const float> dn, const NoiseProfile& profile,
                                      const std::vector<float>& saturated_dn, int periods) {
  std::vector<std::optional<RowEvidence>> rows(static_cast<std::size_t>(dn.rows()));
  parallel_for(0, dn.rows(), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (std::ptrdiff_t r = begin; r < end; ++r)
      rows[static_cast<std::size_t>(r)] =
          row_evidence(dn, profile, saturated_dn, static_cast<int>(r), periods);
  });
  DifferencesOfRows out;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    if (!rows[r]) continue;
    out.row.push_back(static_cast<int>(r));
    out.value.push_back(rows[r]->value);
    out.explained.push_back(rows[r]->variance);
    out.texture.push_back(rows[r]->texture);
    if (r > 0 && rows[r - 1])
      (r % 2 ? out.within : out.across).push_back(rows[r]->value - rows[r - 1]->value);
  }
  return out;
}

ShownRowVariance variance_beyond(const std::vector<double>& values,
                                 const std::vector<double>& explained) {
  constexpr double kOfDifference = 1.5;  // of an offset less half of two others
  const double spread = std::pow(robust_deviation_of(values), 2);
  // A robust variance of n values has a relative error of 1.65 sqrt(2/n).
  const double error = spread * 1.65 * std::sqrt(2.0 / static_cast<double>(values.size()));
  return {(spread - median_of(explained)) / kOfDifference, error / kOfDifference};
}

std::vector<double> most_of_rows(View<const float> dn, const NoiseProfile& profile,
                                 const std::vector<float>& saturated_dn,
                                 const DifferencesOfRows& rows, int periods) {
  std::vector<double> most(rows.row.size());
  parallel_for(0, std::ssize(most), 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (auto i = static_cast<std::size_t>(begin); i < static_cast<std::size_t>(end); ++i)
      most[i] =
          evidence_of_most(dn, profile, saturated_dn, rows.row[i], periods, kDoubtfulReach)->value;
  });
  return most;
}

// A camera lifts all pixels of a row, a picture some of them by more: the row's mean then varies
// by more than where most of its pixels lie. What is common is the lesser of the two; and what the
// picture adds to the mean's, beyond an error, it may well have added to most pixels' too.
ShownRowVariance common_variance(const DifferencesOfRows& rows, const std::vector<double>& most) {
  const ShownRowVariance of_mean = variance_beyond(rows.value, rows.explained),
                         of_most = variance_beyond(most, rows.explained);
  const double added = std::max(of_mean.value - of_most.value - of_mean.error, 0.0);
  return {std::min(of_mean.value, of_most.value) - added,
          added > 0 ? of_mean.error : std::min(of_mean.error, of_most.error)};
}

// Of the pixel noise at the frame's mean signal, mean over the channels.
double pixel_deviation(View<const float> dn, const NoiseProfile& profile) {
  Moments signal;
  for (int r = 0; r < dn.rows(); ++r)
    for (int c = 0; c < dn.cols(); ++c)
      if (std::isfinite(dn(r, c))) signal.add(dn(r, c));
  double sum = 0;
  for (const ChannelProfile& channel : profile.channels)
    sum += std::sqrt(std::max(channel.variance(signal.mean()), 0.0));
  return sum / static_cast<double>(profile.channels.size());
}

// Values far out count as at the bound.
std::vector<double> held(std::vector<double> values) {
  const double bound = 3 * robust_deviation_of(values);
  for (double& v : values) v = std::clamp(v, -bound, bound);
  return values;
}

double sum_of_squares(const std::vector<double>& values) {
  return std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
}

bool come_in_pairs(const DifferencesOfRows& rows) {
  const auto within = static_cast<double>(rows.within.size()),
             across = static_cast<double>(rows.across.size());
  const double ratio =
      sum_of_squares(held(rows.within)) / within / sum_of_squares(held(rows.across)) * across;
  // Of the ratio's logarithm.
  const double error = std::sqrt(2 * kOfNeighbours * (1 / within + 1 / across));
  return ratio < std::min(kPairedRows, std::exp(-kErrorsOfPairs * error));
}

// Text, bricks, steps: a picture's lines come again at the same distance, a camera's offsets do
// not. Slow ones agree with their neighbours more than with those further away.
bool repeat(const std::vector<double>& all) {
  const std::vector<double> values = held(all);
  const double energy = sum_of_squares(values);
  const std::size_t n = values.size();
  const auto agreement = [&](std::size_t lag) {
    double sum = 0;
    for (std::size_t i = lag; i < n; ++i) sum += values[i] * values[i - lag];
    return sum / energy * static_cast<double>(n) / static_cast<double>(n - lag);
  };
  std::vector<double> at = {1.0};
  for (std::size_t lag = 1; energy > 0 && lag <= n / 3; ++lag) {
    at.push_back(agreement(lag));
    if (lag >= kLeastPeriod &&
        at[lag] - std::max(at[lag / 2], 0.0) > kRepeats / std::sqrt(static_cast<double>(n - lag)))
      return true;
  }
  return false;
}

// Rows two apart share no draw, nor do those four rows above and below that they are compared with;
// lines and edges of a picture mostly are wider. A bright band in a part of the frame says nothing
// of its other rows: most parts have to agree.
bool come_in_runs(View<const float> dn, const NoiseProfile& profile,
                  const std::vector<float>& saturated_dn) {
  constexpr int kCompared = 4;
  constexpr std::size_t kLag = 2, kPart = 32;
  constexpr double kAlike = 0.15, kErrors = 3.0;
  const DifferencesOfRows rows =
      differences_of_rows(dn, profile, saturated_dn, cells_apart(profile, kCompared));
  const double variance = std::pow(robust_deviation_of(rows.value), 2);
  std::vector<double> shared;
  for (std::size_t first = 0; first + kPart + kLag <= rows.value.size(); first += kPart) {
    double sum = 0;
    for (std::size_t i = first; i < first + kPart; ++i) sum += rows.value[i] * rows.value[i + kLag];
    shared.push_back(sum / static_cast<double>(kPart));
  }
  if (shared.empty()) return false;
  // Of a median of means of products of white values.
  const double error = 1.25 * variance / std::sqrt(static_cast<double>(shared.size() * kPart)),
               beyond = variance - median_of(rows.explained);
  return median_of(shared) - median_of(rows.texture) - kErrors * error > kAlike * beyond;
}

}  // namespace

std::optional<ShownRowVariance> shown_row_variance(View<const float> dn,
                                                   const NoiseProfile& profile,
                                                   const std::vector<float>& saturated_dn) {
  const DifferencesOfRows rows =
      differences_of_rows(dn, profile, saturated_dn, cells_apart(profile, profile.row_group));
  if (rows.value.size() < kLeastRows) return std::nullopt;
  return variance_beyond(rows.value, rows.explained);
}

void estimate_row_deviation(View<const float> dn, const std::vector<float>& saturated_dn,
                            NoiseProfile& profile) {
  MALUS_REQUIRE(saturated_dn.size() == profile.channels.size());
  // Evidence comes in units of it; small beside the pixels' own, of whose unit all else follows.
  const double pixel = pixel_deviation(dn, profile), unit_dn = kEvidenceUnit * pixel;
  for (ChannelProfile& channel : profile.channels) channel.sigma_row_dn = unit_dn;
  profile.row_group = 1;
  const int periods = cells_apart(profile, 2);  // two rows may share their draw
  const DifferencesOfRows rows = differences_of_rows(dn, profile, saturated_dn, periods);
  double sigma = 0;
  if (rows.value.size() >= kLeastRows) {
    const ShownRowVariance shown =
        common_variance(rows, most_of_rows(dn, profile, saturated_dn, rows, periods));
    if (shown.value > 3 * shown.error) sigma = unit_dn * std::sqrt(shown.value);
    if (sigma > kMostRowDeviation * pixel ||
        (sigma > 0 && (repeat(rows.value) || come_in_runs(dn, profile, saturated_dn))))
      sigma = 0;
    if (come_in_pairs(rows)) profile.row_group = 2;
  }
  for (ChannelProfile& channel : profile.channels) channel.sigma_row_dn = sigma;
}

}  // namespace malus
