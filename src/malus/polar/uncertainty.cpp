#include "malus/polar/uncertainty.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/polar/internal/angle_error.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

const double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Variance of (S1, S2) across its own direction, in the intensities' unit squared.
double tangential_variance(const Stokes& s, const StokesCovariance& v) {
  const double p2 = s.s1 * s.s1 + s.s2 * s.s2;
  return (s.s2 * s.s2 * v.s1s1 + s.s1 * s.s1 * v.s2s2 - 2 * s.s1 * s.s2 * v.s1s2) / p2;
}

// Correlation of a filter's errors between the angles, and between sites of one angle, of one or of
// several colours: they are mostly of what all of these share, so they do not average out, neither
// in S0 nor in the mean of sites, and of like size they partly cancel in S1 and S2, which are
// differences (docs/uncertainty.md has the measurements). Noise of samples that a filter returns is
// not shared; variances do not tell it apart, and denoise/residual_evidence.cpp states more of it.
constexpr double kSharedError = 0.35;

// Colours whose mean is one, as green is that of both greens; the groups weigh alike.
using Groups = std::vector<std::vector<Color>>;

struct SiteWeight {
  int channel;
  double weight;
};

// What the sites of one angle weigh in the mean over the groups.
std::vector<SiteWeight> site_weights(const SensorLayout& layout, const Groups& groups,
                                     int angle_deg) {
  std::vector<SiteWeight> all;
  for (const auto& group : groups)
    for (const Color color : group) {
      const std::size_t first = all.size();
      for (int k = 0; k < layout.channels(); ++k)
        if (layout.site(k) == Site{color, angle_deg}) all.push_back({k, 0});
      for (std::size_t i = first; i < all.size(); ++i)
        all[i].weight =
            1.0 / static_cast<double>(groups.size() * group.size() * (all.size() - first));
    }
  return all;
}

// Of the mean of errors that are correlated by `shared`, pixel by pixel.
Image variance_of_mean(const Planes& packed_variance, const std::vector<SiteWeight>& sites,
                       double shared) {
  Image mean(packed_variance.rows(), packed_variance.cols());
  parallel_for(0, mean.rows(), kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
      for (int c = 0; c < mean.cols(); ++c) {
        double variance = 0, deviation = 0;  // of independent errors, of errors that are all alike
        for (const SiteWeight& site : sites) {
          const double v = packed_variance[site.channel](r, c);
          variance += site.weight * site.weight * v;
          deviation += site.weight * std::sqrt(v);
        }
        mean(r, c) = static_cast<float>(
            shared > 0 ? (1 - shared) * variance + shared * deviation * deviation : variance);
      }
  });
  return mean;
}

AngleImages angle_variances(const Planes& packed_variance, const SensorLayout& layout,
                            const Groups& groups, Intensities intensities) {
  const double shared = intensities == Intensities::kMeasured ? 0.0 : kSharedError;
  const auto of = [&](int angle_deg) {
    return variance_of_mean(packed_variance, site_weights(layout, groups, angle_deg), shared);
  };
  return {of(0), of(45), of(90), of(135)};
}

// One site's part in the Stokes parameters of the mean over the groups, of an offset of one
// deviation of its line's.
struct SiteOffset {
  int channel;
  Stokes part;
};

std::vector<SiteOffset> site_offsets(const SensorLayout& layout, const Groups& groups,
                                     const LineOffsets& lines) {
  std::vector<SiteOffset> all;
  for (const int angle_deg : {0, 45, 90, 135})
    for (const SiteWeight& site : site_weights(layout, groups, angle_deg)) {
      const double offset = site.weight * lines.sd_dn[static_cast<std::size_t>(site.channel)];
      const auto behind = [&](int deg) { return deg == angle_deg ? offset : 0.0; };
      all.push_back({site.channel, stokes_of(behind(0), behind(45), behind(90), behind(135))});
    }
  return all;
}

// What the offsets of lines add to a covariance in which they count as independent, of the cells
// from the frame's first line on until their lines meet the groups alike again; empty without
// offsets. line_of(channel): in a cell of so many lines.
template <class LineOf>
std::vector<StokesCovariance> added_by(const LineOffsets& lines, int cell_lines,
                                       const LineOf& line_of, const SensorLayout& layout,
                                       const Groups& groups) {
  if (lines.sd_dn.empty()) return {};
  MALUS_REQUIRE(std::ssize(lines.sd_dn) == layout.channels() && lines.group_lines >= 1);
  const std::vector<SiteOffset> sites = site_offsets(layout, groups, lines);
  const int period = std::lcm(cell_lines, lines.group_lines) / cell_lines;
  std::vector<StokesCovariance> added(static_cast<std::size_t>(period));
  for (int cell = 0; cell < period; ++cell) {
    const auto group_of = [&](const SiteOffset& site) {
      return (cell * cell_lines + line_of(site.channel)) / lines.group_lines;
    };
    StokesCovariance& v = added[static_cast<std::size_t>(cell)];
    for (const SiteOffset& a : sites)
      for (const SiteOffset& b : sites) {
        if (&a == &b) continue;
        const auto lag = static_cast<std::size_t>(std::abs(group_of(a) - group_of(b)));
        if (lag > lines.correlation.size()) continue;
        const double correlation = lag == 0 ? 1.0 : lines.correlation[lag - 1];
        v.s0s0 += correlation * a.part.s0 * b.part.s0;
        v.s1s1 += correlation * a.part.s1 * b.part.s1;
        v.s2s2 += correlation * a.part.s2 * b.part.s2;
        v.s0s1 += correlation * a.part.s0 * b.part.s1;
        v.s0s2 += correlation * a.part.s0 * b.part.s2;
        v.s1s2 += correlation * a.part.s1 * b.part.s2;
      }
  }
  return added;
}

// By cell row and by cell column, over and over.
struct AddedCovariances {
  std::vector<StokesCovariance> by_row, by_column;
};

AddedCovariances added_covariances(const SensorLayout& layout, const Groups& groups,
                                   const SharedOffsets& offsets) {
  const int cols = layout.cols();
  return {
      added_by(
          offsets.rows, layout.rows(), [&](int channel) { return channel / cols; }, layout, groups),
      added_by(
          offsets.columns, cols, [&](int channel) { return channel % cols; }, layout, groups)};
}

StokesCovariance at_cell(const std::vector<StokesCovariance>& added, int cell) {
  return added.empty() ? StokesCovariance() : added[static_cast<std::size_t>(cell) % added.size()];
}

StokesCovariance sum_of(const StokesCovariance& a, const StokesCovariance& b) {
  return {a.s0s0 + b.s0s0, a.s1s1 + b.s1s1, a.s2s2 + b.s2s2,
          a.s0s1 + b.s0s1, a.s0s2 + b.s0s2, a.s1s2 + b.s1s2};
}

// The colours of the layout that the picture shows under each of its names.
Groups groups_of(const StokesPicture& picture, const SensorLayout& layout) {
  Groups groups;
  for (const std::string& name : picture.names) {
    groups.emplace_back();
    for (const Color color : layout.colors())
      if (display_name(color) == name) groups.back().push_back(color);
  }
  return groups;
}

// Of the variance stated of a denoised (S1, S2), what lengthens it: it is uneven, and DoLP errs
// least with less than all of it. Twice as much would bring the mean of pictures up to the truth,
// and carry that of scenes that lost no polarization as far beyond it (docs/uncertainty.md has the
// measurement).
constexpr double kLengtheningShare = 0.15;

// Mean length of a vector about one of `length`, with the variance of each of two components.
double rice_mean(double length, double variance) {
  const double y = length * length / (4 * variance);
  if (y > 50) return length + variance / (2 * length) * (1 + variance / (4 * length * length));
  return std::sqrt(std::numbers::pi / 2 * variance) * std::exp(-y) *
         ((1 + 2 * y) * std::cyl_bessel_i(0.0, y) + 2 * y * std::cyl_bessel_i(1.0, y));
}

bool without_direction(const Stokes& s) { return s.s1 == 0 && s.s2 == 0; }

}  // namespace

StokesCovariance stokes_covariance(double v0, double v45, double v90, double v135, double shared) {
  const StokesCovariance independent{0.25 * (v0 + v45 + v90 + v135),
                                     v0 + v90,
                                     v45 + v135,
                                     0.5 * (v0 - v90),
                                     0.5 * (v45 - v135),
                                     0};
  if (shared == 0) return independent;
  // What independent errors and errors that are all alike give, as in variance_of_mean.
  const Stokes d = stokes_of(std::sqrt(v0), std::sqrt(v45), std::sqrt(v90), std::sqrt(v135));
  const auto mixed = [&](double one, double other) { return (1 - shared) * one + shared * other; };
  return {mixed(independent.s0s0, d.s0 * d.s0), mixed(independent.s1s1, d.s1 * d.s1),
          mixed(independent.s2s2, d.s2 * d.s2), mixed(independent.s0s1, d.s0 * d.s1),
          mixed(independent.s0s2, d.s0 * d.s2), mixed(independent.s1s2, d.s1 * d.s2)};
}

double dolp_variance(const Stokes& s, const StokesCovariance& v) {
  if (!(s.s0 > 0)) return kUnknown;
  if (without_direction(s)) return std::min(0.5 * (v.s1s1 + v.s2s2) / (s.s0 * s.s0), 1.0);
  const double p = std::hypot(s.s1, s.s2), most = std::max(p / s.s0, 1.0);
  const double d0 = -p / (s.s0 * s.s0), d1 = s.s1 / (p * s.s0), d2 = s.s2 / (p * s.s0);
  const double first_order = d0 * d0 * v.s0s0 + d1 * d1 * v.s1s1 + d2 * d2 * v.s2s2 +
                             2 * (d0 * d1 * v.s0s1 + d0 * d2 * v.s0s2 + d1 * d2 * v.s1s2);
  return std::min(first_order, most * most);
}

double aolp_variance_deg2(const Stokes& s, const StokesCovariance& v, Intensities intensities) {
  if (!(s.s0 > 0)) return kUnknown;
  if (without_direction(s)) return kUnknownAngleVarianceDeg2;
  const double across = tangential_variance(s, v), p2 = s.s1 * s.s1 + s.s2 * s.s2;
  const double determinant = v.s1s1 * v.s2s2 - v.s1s2 * v.s1s2;
  // Signal in deviations of its own direction: what lies behind it is told by these. How far that
  // turns the angle is told by those across, as long as there is an angle.
  const double signal2 = determinant > 0 ? p2 * across / determinant : p2 / across;
  const double flatness = determinant > 0 ? across * across / determinant : 1.0;
  const double error = internal::aolp_error_deg2(std::sqrt(signal2), intensities);
  const double unknown = error / kUnknownAngleVarianceDeg2;
  return std::min(kUnknownAngleVarianceDeg2, error * std::lerp(flatness, 1.0, unknown));
}

double corrected_dolp(const Stokes& s, const StokesCovariance& v) {
  const double p = dolp_of(s);
  if (std::isnan(p) || without_direction(s)) return p;
  const double b2 = tangential_variance(s, v) / (s.s0 * s.s0);
  if (!(b2 > 0)) return p;
  return p + b2 * std::expm1(-p * p / b2) / (2 * p);
}

double expected_dolp(const Stokes& s, const StokesCovariance& v) {
  const double p = dolp_of(s), variance = kLengtheningShare * 0.5 * (v.s1s1 + v.s2s2);
  if (std::isnan(p) || !(variance > 0)) return p;
  return std::min(rice_mean(std::hypot(s.s1, s.s2), variance) / s.s0, std::max(p, 1.0));
}

namespace {

// added: to covariances in which offsets count as independent.
StokesUncertainty propagated(const StokesPlanes& stokes, const AnglePlanes& variance,
                             Intensities intensities, const AddedCovariances& added) {
  const int rows = stokes.s0.rows(), cols = stokes.s0.cols();
  for (const auto& plane : {variance.i0, variance.i45, variance.i90, variance.i135})
    MALUS_REQUIRE(plane.rows() == rows && plane.cols() == cols);
  const Image blank(rows, cols);
  StokesUncertainty out{blank, blank, blank, blank, blank, blank};
  const double shared = intensities == Intensities::kMeasured ? 0.0 : kSharedError;
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r) {
      const StokesCovariance of_row = at_cell(added.by_row, r);
      for (int c = 0; c < cols; ++c) {
        const Stokes s{stokes.s0(r, c), stokes.s1(r, c), stokes.s2(r, c)};
        const StokesCovariance v =
            sum_of(stokes_covariance(variance.i0(r, c), variance.i45(r, c), variance.i90(r, c),
                                     variance.i135(r, c), shared),
                   sum_of(of_row, at_cell(added.by_column, c)));
        out.s0_variance(r, c) = static_cast<float>(v.s0s0);
        out.s1_variance(r, c) = static_cast<float>(v.s1s1);
        out.s2_variance(r, c) = static_cast<float>(v.s2s2);
        // AoLP's bound would call an angle known to half a circle where nothing at all is.
        if (!std::isfinite(v.s0s0)) {
          for (Image* plane : {&out.dolp_sd, &out.aolp_sd_deg, &out.dolp_corrected})
            (*plane)(r, c) = static_cast<float>(kUnknown);
          continue;
        }
        out.dolp_sd(r, c) = static_cast<float>(std::sqrt(dolp_variance(s, v)));
        out.aolp_sd_deg(r, c) =
            static_cast<float>(std::sqrt(aolp_variance_deg2(s, v, intensities)));
        out.dolp_corrected(r, c) = static_cast<float>(
            intensities == Intensities::kMeasured ? corrected_dolp(s, v) : expected_dolp(s, v));
      }
    }
  });
  return out;
}

}  // namespace

StokesUncertainty propagate(const StokesPlanes& stokes, const AnglePlanes& variance,
                            Intensities intensities) {
  return propagated(stokes, variance, intensities, {});
}

void require_variances(const Planes& packed_variance, const SensorLayout& layout,
                       const std::string& source) {
  for (int k = 0; k < packed_variance.channels(); ++k)
    for (int r = 0; r < packed_variance.rows(); ++r)
      for (int c = 0; c < packed_variance.cols(); ++c)
        if (const float variance = packed_variance[k](r, c); variance < 0)
          throw InputError(source,
                           fmt::format("a variance is negative: {:g} DN² in row {}, column {}",
                                       variance, r * layout.rows() + k / layout.cols(),
                                       c * layout.cols() + k % layout.cols()),
                           "give squares of deviations, NaN where they are not known");
}

std::vector<StokesUncertainty> uncertainty_per_color(const std::vector<StokesPlanes>& stokes,
                                                     const Planes& packed_variance,
                                                     const SensorLayout& layout,
                                                     Intensities intensities) {
  const std::vector<Color> colors = layout.colors();
  MALUS_REQUIRE(stokes.size() == colors.size());
  std::vector<StokesUncertainty> all;
  for (std::size_t i = 0; i < colors.size(); ++i)
    all.push_back(propagate(stokes[i],
                            angle_variances(packed_variance, layout, {{colors[i]}}, intensities),
                            intensities));
  return all;
}

std::vector<StokesUncertainty> uncertainty_of(const StokesPicture& picture,
                                              const Planes& packed_variance,
                                              const SensorLayout& layout, Intensities intensities,
                                              const SharedOffsets& offsets) {
  std::vector<StokesUncertainty> all;
  const Groups groups = groups_of(picture, layout);
  for (std::size_t i = 0; i < groups.size(); ++i)
    all.push_back(propagated(picture.planes[i],
                             angle_variances(packed_variance, layout, {groups[i]}, intensities),
                             intensities, added_covariances(layout, {groups[i]}, offsets)));
  return all;
}

StokesUncertainty uncertainty_of_mean(const StokesPicture& picture, const Planes& packed_variance,
                                      const SensorLayout& layout, Intensities intensities,
                                      const SharedOffsets& offsets) {
  const Groups groups = groups_of(picture, layout);
  return propagated(mean_stokes(picture.planes),
                    angle_variances(packed_variance, layout, groups, intensities), intensities,
                    added_covariances(layout, groups, offsets));
}

}  // namespace malus
