#include "malus/denoise/row_noise.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/denoise/row_posterior.h"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>
#include <utility>

namespace malus {
namespace {

constexpr int kSegments = 16;          // a row's own spread is judged between so many parts of it
constexpr double kInfluenceEnd = 3.0;  // deviations at which a pixel's influence ends
constexpr double kOutlierFreedom =
    4.0;  // of Student's law for rows that the picture explains better
constexpr int kReweightings = 4;
// Rows are compared with neighbours so many periods of the layout away: near ones see the least of
// the picture, far ones the slow waves of the offsets.
constexpr int kDistances[] = {1, 2, 4};
// The comparisons of one row share its noise: together they are worth less than their number.
constexpr double kShared = 2.0;
constexpr std::size_t kLeastRows = 64;  // for the deviation to be estimated from a picture
// Offsets that deviate by more than this, in units of the model's, are not the camera's alone: a
// warmer camera's rows may well be half as strong again. Only so many groups tell.
constexpr double kTooWide = 2.0;
constexpr std::size_t kLeastGroups = 32;
// Of the groups that are taken for lines of the picture so many, on average, may be noise.
constexpr double kFalseLines = 0.05;
constexpr int kLineRounds = 3;  // without the lines that are found their neighbours tell of others
// A camera's rows differ by no more than this many deviations of its pixels: blinds and stripes do.
constexpr double kMostRowDeviation = 2.0;
// The unit, in deviations of the pixels, that a picture's own row noise is measured in.
constexpr double kEvidenceUnit = 0.25;
// Rows 2k and 2k+1 differ by so much less than 2k+1 and 2k+2 when they share their draws.
constexpr double kPairedRows = 0.8;

// Offsets that repeat after so many rows or more agree by this over the root of their number: five
// deviations of what chance gives, for neighbouring comparisons share rows (Bartlett, 1946).
constexpr std::size_t kLeastPeriod = 9;
constexpr double kRepeats = 7.0;

// Weighted sums over one part of a row.
struct SegmentSum {
  double weighted = 0, weight = 0;
};

std::optional<RowEvidence> row_evidence(View<const float> dn, const NoiseProfile& profile,
                                        const std::vector<float>& saturated_dn, int row,
                                        int periods) {
  const SensorLayout& layout = profile.layout;
  const int distance = periods * layout.rows();
  if (row - distance < 0 || row + distance >= dn.rows()) return std::nullopt;
  const float *above = dn.row(row - distance), *here = dn.row(row), *below = dn.row(row + distance);
  SegmentSum parts[kSegments];
  for (int c = 0; c < dn.cols(); ++c) {
    const auto k = static_cast<std::size_t>(layout.channel_at(row, c));
    const ChannelProfile& channel = profile.channels[k];
    const double sigma = channel.sigma_row_dn;
    const float top = std::max({above[c], here[c], below[c]});
    if (!(sigma > 0) || !(top < saturated_dn[k]) || !std::isfinite(above[c] + here[c] + below[c]))
      continue;
    const double mean = (static_cast<double>(above[c]) + here[c] + below[c]) / 3.0;
    const double variance = 1.5 * (channel.variance(mean) + sigma * sigma);
    const double bound = kInfluenceEnd * std::sqrt(variance);
    const double difference =
        std::clamp(here[c] - 0.5 * (static_cast<double>(above[c]) + below[c]), -bound, bound);
    SegmentSum& part = parts[static_cast<std::ptrdiff_t>(c) * kSegments / dn.cols()];
    part.weighted += sigma * difference / variance;
    part.weight += sigma * sigma / variance;
  }
  double weighted = 0, weight = 0;
  int used = 0;
  for (const SegmentSum& part : parts)
    if (part.weight > 0) {
      weighted += part.weighted;
      weight += part.weight;
      ++used;
    }
  if (used == 0) return std::nullopt;
  const double value = weighted / weight;
  double spread = 0;
  for (const SegmentSum& part : parts)
    if (part.weight > 0)
      spread += part.weight * part.weight * std::pow(part.weighted / part.weight - value, 2);
  // The pixel noise alone explains 1/weight; texture makes the parts of the row differ by more.
  const double between = used > 1 ? spread / (weight * weight) * used / (used - 1) : 0;
  const int group = profile.row_group;
  return RowEvidence{row / group, (row - distance) / group, (row + distance) / group, value,
                     std::max(1.0 / weight, between)};
}

// Second differences of neighbouring rows, what pixel noise and picture explain of their variance,
// and how the differences of rows 2k, 2k+1 and of rows 2k+1, 2k+2 differ.
struct DifferencesOfRows {
  std::vector<double> value, explained, within, across;
};

DifferencesOfRows differences_of_rows(View<const float> dn, const NoiseProfile& profile,
                                      const std::vector<float>& saturated_dn) {
  std::vector<std::optional<RowEvidence>> rows;
  for (int r = 0; r < dn.rows(); ++r) rows.push_back(row_evidence(dn, profile, saturated_dn, r, 1));
  DifferencesOfRows out;
  for (std::size_t r = 0; r < rows.size(); ++r) {
    if (!rows[r]) continue;
    out.value.push_back(rows[r]->value);
    out.explained.push_back(rows[r]->variance);
    if (r > 0 && rows[r - 1])
      (r % 2 ? out.within : out.across).push_back(rows[r]->value - rows[r - 1]->value);
  }
  return out;
}

ShownRowVariance variance_beyond(const DifferencesOfRows& rows) {
  constexpr double kOfDifference = 1.5;  // of an offset less half of two others
  const double spread = std::pow(robust_deviation_of(rows.value), 2);
  // A robust variance of n values has a relative error of 1.65 sqrt(2/n).
  const double error = spread * 1.65 * std::sqrt(2.0 / static_cast<double>(rows.value.size()));
  return {(spread - median_of(rows.explained)) / kOfDifference, error / kOfDifference};
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

// Level stripes of the picture look like rows that are lifted, but by more than the model's offsets
// are wide. Of a sum of deviation d the offsets, of deviation 1, are expected to be 1/d² (Wiener).
void leave_stripes(RowNoise& rows, double wide) {
  for (double& offset : rows.offset) offset /= wide * wide;
  rows.deviation.assign(rows.deviation.size(), 1.0);
}

// Single lines of the picture: groups that stand out further than offsets of this width do. As many
// as keep the expected share of noise among them and the `known` ones low (Benjamini and Hochberg,
// J. R. Statist. Soc. B 57, 1995).
std::vector<int> lines_in(const RowNoise& rows, double wide, std::size_t known) {
  std::vector<int> furthest(rows.offset.size());
  std::iota(furthest.begin(), furthest.end(), 0);
  const auto size = [&](int group) {
    return std::abs(rows.offset[static_cast<std::size_t>(group)]);
  };
  std::sort(furthest.begin(), furthest.end(), [&](int a, int b) { return size(a) > size(b); });
  const auto expected = [&](double offset) {  // groups of noise as far out
    return static_cast<double>(furthest.size()) * std::erfc(offset / (wide * std::numbers::sqrt2));
  };
  std::size_t lines = 0;
  for (std::size_t k = 0; k < furthest.size(); ++k)
    if (expected(size(furthest[k])) <= kFalseLines * static_cast<double>(known + k + 1))
      lines = k + 1;
  furthest.resize(lines);
  return furthest;
}

RowNoise solved(const std::vector<RowEvidence>& evidence, int groups) {
  RowNoise rows;
  std::vector<double> variance;
  for (const RowEvidence& e : evidence) variance.push_back(e.variance);
  for (int pass = 0; pass < kReweightings; ++pass) {
    rows = row_posterior(evidence, variance, groups);
    for (std::size_t i = 0; i < evidence.size(); ++i) {
      const RowEvidence& e = evidence[i];
      const auto offset = [&](int g) { return rows.offset[static_cast<std::size_t>(g)]; };
      const double residual =
          e.value - (offset(e.group) - 0.5 * (offset(e.above) + offset(e.below)));
      // Student's law by reweighting (Lange, Little, Taylor, JASA 84, 1989).
      variance[i] = e.variance * (kOutlierFreedom + residual * residual / e.variance) /
                    (kOutlierFreedom + 1.0);
    }
  }
  return rows;
}

double width_of(const RowNoise& rows) {
  std::vector<double> size;
  for (const double offset : rows.offset) size.push_back(std::abs(offset));
  return median_of(size) / kMedianOfNormal;
}

// Lines of the picture take no part: nothing tells their own offsets, and their neighbours' are
// told by others.
RowNoise solved_without_lines(std::vector<RowEvidence> evidence, int groups) {
  RowNoise rows = solved(evidence, groups);
  if (rows.offset.size() < kLeastGroups) return rows;
  std::vector<char> is_line(rows.offset.size(), 0);
  std::size_t known = 0;
  for (int round = 0; round < kLineRounds; ++round) {
    const double wide = width_of(rows);
    if (wide > kTooWide) {
      leave_stripes(rows, wide);
      return rows;
    }
    const std::vector<int> lines = lines_in(rows, std::max(wide, 1.0), known);
    if (lines.empty()) return rows;
    known += lines.size();
    for (const int group : lines) is_line[static_cast<std::size_t>(group)] = 1;
    std::erase_if(evidence, [&](const RowEvidence& e) {
      const auto of_line = [&](int group) { return is_line[static_cast<std::size_t>(group)] != 0; };
      return of_line(e.group) || of_line(e.above) || of_line(e.below);
    });
    rows = solved(evidence, groups);
  }
  return rows;
}

// Text, bricks, steps: a picture's lines come again at the same distance, a camera's offsets do
// not. Slow ones agree with their neighbours more than with those further away.
bool repeat(std::vector<double> values) {
  const double bound = 3 * robust_deviation_of(values);
  double energy = 0;
  for (double& v : values) {
    v = std::clamp(v, -bound, bound);
    energy += v * v;
  }
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

}  // namespace

RowNoise estimate_row_noise(View<const float> dn, const NoiseProfile& profile,
                            const std::vector<float>& saturated_dn) {
  MALUS_REQUIRE(profile.row_group >= 1 && saturated_dn.size() == profile.channels.size());
  const int groups = (dn.rows() + profile.row_group - 1) / profile.row_group;
  RowNoise rows{std::vector<double>(static_cast<std::size_t>(groups), 0.0),
                std::vector<double>(static_cast<std::size_t>(groups), 1.0)};
  const std::ptrdiff_t count = std::ssize(kDistances) * dn.rows();
  std::vector<std::optional<RowEvidence>> found(static_cast<std::size_t>(count));
  parallel_for(0, count, 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (std::ptrdiff_t i = begin; i < end; ++i)
      found[static_cast<std::size_t>(i)] = row_evidence(
          dn, profile, saturated_dn, static_cast<int>(i % dn.rows()), kDistances[i / dn.rows()]);
  });
  std::vector<RowEvidence> evidence;
  for (const auto& e : found)
    if (e && !(e->group == e->above && e->group == e->below)) {
      evidence.push_back(*e);
      evidence.back().variance *= kShared;
    }
  if (evidence.empty()) return rows;
  return solved_without_lines(std::move(evidence), groups);
}

void remove_row_noise(View<float> dn, const NoiseProfile& profile, const RowNoise& rows,
                      const SaturatedPixels& saturated) {
  parallel_for(0, dn.rows(), 32, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
      const double offset = rows.offset[static_cast<std::size_t>(r / profile.row_group)];
      float* to = dn.row(r);
      for (int c = 0; c < dn.cols(); ++c) {
        const auto k = static_cast<std::size_t>(profile.layout.channel_at(r, c));
        if (!saturated(r, c))
          to[c] -= static_cast<float>(offset * profile.channels[k].sigma_row_dn);
      }
    }
  });
}

std::optional<ShownRowVariance> shown_row_variance(View<const float> dn,
                                                   const NoiseProfile& profile,
                                                   const std::vector<float>& saturated_dn) {
  const DifferencesOfRows rows = differences_of_rows(dn, profile, saturated_dn);
  if (rows.value.size() < kLeastRows) return std::nullopt;
  return variance_beyond(rows);
}

void estimate_row_deviation(View<const float> dn, const std::vector<float>& saturated_dn,
                            NoiseProfile& profile) {
  MALUS_REQUIRE(saturated_dn.size() == profile.channels.size());
  // Evidence comes in units of it; small beside the pixels' own, of whose unit all else follows.
  const double pixel = pixel_deviation(dn, profile), unit_dn = kEvidenceUnit * pixel;
  for (ChannelProfile& channel : profile.channels) channel.sigma_row_dn = unit_dn;
  profile.row_group = 1;
  const DifferencesOfRows rows = differences_of_rows(dn, profile, saturated_dn);
  double sigma = 0;
  if (rows.value.size() >= kLeastRows) {
    const ShownRowVariance shown = variance_beyond(rows);
    if (shown.value > 3 * shown.error) sigma = unit_dn * std::sqrt(shown.value);
    if (sigma > kMostRowDeviation * pixel || (sigma > 0 && repeat(rows.value))) sigma = 0;
    if (robust_deviation_of(rows.within) < kPairedRows * robust_deviation_of(rows.across))
      profile.row_group = 2;
  }
  for (ChannelProfile& channel : profile.channels) channel.sigma_row_dn = sigma;
}

}  // namespace malus
