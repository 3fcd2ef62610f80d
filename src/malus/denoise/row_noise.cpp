#include "malus/denoise/row_noise.h"

#include "malus/base/normal_distribution.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/denoise/internal/line_offsets.h"
#include "malus/denoise/internal/row_evidence.h"
#include "malus/denoise/internal/row_stripes.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <optional>
#include <utility>

namespace malus {
namespace {

// Of Student's law for rows that the picture explains better.
constexpr double kOutlierFreedom = 4.0;
constexpr int kReweightings = 4;
// Rows are compared with neighbours this many periods of the layout away: near ones see the least
// of the picture, far ones the slow waves of the offsets.
constexpr int kDistances[] = {1, 2, 4};
// Pixels this many deviations from where most of their row lies are the picture's: where all is
// noise that errs by a fortieth more than the row's mean (Huber, Ronchetti, Robust Statistics,
// 2009, 4.8).
constexpr double kReach = 4.685;
// The comparisons of one row share its noise: together they are worth less than their number.
constexpr double kShared = 2.0;
// Offsets that deviate by more than this, in units of the model's, are not the camera's alone: a
// warmer camera's rows may well be half as strong again. Fewer groups than kLeastGroups do not
// tell.
constexpr double kTooWide = 2.0;
constexpr std::size_t kLeastGroups = 32;
// On average this many of the groups that are taken for lines of the picture may be noise.
constexpr double kFalseLines = 0.05;
constexpr int kLineRounds = 3;  // without the lines that are found their neighbours tell of others

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
    return static_cast<double>(furthest.size()) * 2 * normal_cdf(-offset / wide);
  };
  std::size_t lines = 0;
  for (std::size_t k = 0; k < furthest.size(); ++k)
    if (expected(size(furthest[k])) <= kFalseLines * static_cast<double>(known + k + 1))
      lines = k + 1;
  furthest.resize(lines);
  return furthest;
}

RowNoise solved(const std::vector<RowEvidence>& evidence, int groups, const RowDrift& drift) {
  RowNoise rows;
  std::vector<double> variance;
  for (const RowEvidence& e : evidence) variance.push_back(e.variance);
  for (int pass = 0; pass < kReweightings; ++pass) {
    rows = row_posterior(evidence, variance, groups, drift);
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
RowNoise solved_without_lines(std::vector<RowEvidence> evidence, int groups,
                              const RowDrift& drift) {
  RowNoise rows = solved(evidence, groups, drift);
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
    rows = solved(evidence, groups, drift);
  }
  return rows;
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
      found[static_cast<std::size_t>(i)] =
          evidence_of_most(dn, profile, saturated_dn, static_cast<int>(i % dn.rows()),
                           kDistances[i / dn.rows()], kReach);
  });
  std::vector<RowEvidence> evidence;
  for (const auto& e : found)
    if (e && !(e->group == e->above && e->group == e->below)) {
      evidence.push_back(*e);
      evidence.back().variance *= kShared;
    }
  if (evidence.empty()) return rows;
  rows = solved_without_lines(std::move(evidence), groups, profile.row_drift);
  leave_stripes_in(rows, profile.row_drift);
  return rows;
}

void remove_row_noise(View<float> dn, const NoiseProfile& profile, const RowNoise& rows,
                      const SaturatedPixels& saturated) {
  internal::subtract_offsets(
      dn, profile, &ChannelProfile::sigma_row_dn, saturated,
      [&](int row, int) { return rows.offset[static_cast<std::size_t>(row / profile.row_group)]; });
}

}  // namespace malus
