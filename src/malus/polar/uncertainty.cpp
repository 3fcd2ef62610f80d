#include "malus/polar/uncertainty.h"

#include "malus/base/parallel.h"

#include <algorithm>
#include <array>

namespace malus {
namespace {

const double kUnknown = std::numeric_limits<double>::quiet_NaN();

// Variance of (S1, S2) across its own direction, in the intensities' unit squared.
double tangential_variance(const Stokes& s, const StokesCovariance& v) {
  const double p2 = s.s1 * s.s1 + s.s2 * s.s2;
  return (s.s2 * s.s2 * v.s1s1 + s.s1 * s.s1 * v.s2s2 - 2 * s.s1 * s.s2 * v.s1s2) / p2;
}

// Correlation of a filter's errors between the angles, and between sites of one colour and angle as
// of both greens: they are mostly of what all of these share, so they do not average out, neither
// in S0 nor in the mean of sites, and partly cancel in S1 and S2, which are differences
// (docs/uncertainty.md has the measurements).
constexpr double kSharedError = 0.35;

// Variance of the mean over the colours of the mean over each colour's sites.
AngleImages angle_variances(const Planes& packed_variance, const SensorLayout& layout,
                            const std::vector<Color>& colors, Intensities intensities) {
  const double shared = intensities == Intensities::kMeasured ? 0.0 : kSharedError;
  std::array<Image, 4> angles;
  for (int a = 0; a < 4; ++a) {
    Image& sum = angles[static_cast<std::size_t>(a)];
    sum = Image(packed_variance.rows(), packed_variance.cols());
    int sites = 0;
    for (Color color : colors) {
      const SiteMean mean = mean_of_sites(packed_variance, layout, color, 45 * a);
      const auto share = static_cast<float>(
          1.0 / (mean.sites * static_cast<double>(colors.size() * colors.size())));
      for (std::size_t i = 0; i < sum.size(); ++i)
        sum.values()[i] += share * mean.image.values()[i];
      sites += mean.sites;
    }
    for (float& v : sum.values()) v *= static_cast<float>(1 + (sites - 1) * shared);
  }
  return {std::move(angles[0]), std::move(angles[1]), std::move(angles[2]), std::move(angles[3])};
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

double dolp_variance(const Stokes& s, const StokesCovariance& v) {
  if (!(s.s0 > 0)) return kUnknown;
  if (without_direction(s)) return std::min(0.5 * (v.s1s1 + v.s2s2) / (s.s0 * s.s0), 1.0);
  const double p = std::hypot(s.s1, s.s2), most = std::max(p / s.s0, 1.0);
  const double d0 = -p / (s.s0 * s.s0), d1 = s.s1 / (p * s.s0), d2 = s.s2 / (p * s.s0);
  const double first_order = d0 * d0 * v.s0s0 + d1 * d1 * v.s1s1 + d2 * d2 * v.s2s2 +
                             2 * (d0 * d1 * v.s0s1 + d0 * d2 * v.s0s2 + d1 * d2 * v.s1s2);
  return std::min(first_order, most * most);
}

double aolp_variance_deg2(const Stokes& s, const StokesCovariance& v) {
  if (!(s.s0 > 0)) return kUnknown;
  if (without_direction(s)) return kUnknownAngleVarianceDeg2;
  constexpr double kHalfRadianDeg = 90.0 / std::numbers::pi;  // AoLP is half the phase
  const double p2 = s.s1 * s.s1 + s.s2 * s.s2;
  return std::min(kUnknownAngleVarianceDeg2,
                  kHalfRadianDeg * kHalfRadianDeg * tangential_variance(s, v) / p2);
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

StokesUncertainty propagate(const StokesPlanes& stokes, const AnglePlanes& variance,
                            Intensities intensities) {
  const int rows = stokes.s0.rows(), cols = stokes.s0.cols();
  for (const auto& plane : {variance.i0, variance.i45, variance.i90, variance.i135})
    MALUS_REQUIRE(plane.rows() == rows && plane.cols() == cols);
  const Image blank(rows, cols);
  StokesUncertainty out{blank, blank, blank, blank, blank, blank};
  const double shared = intensities == Intensities::kMeasured ? 0.0 : kSharedError;
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t first, std::ptrdiff_t last) {
    for (auto r = static_cast<int>(first); r < static_cast<int>(last); ++r)
      for (int c = 0; c < cols; ++c) {
        const Stokes s{stokes.s0(r, c), stokes.s1(r, c), stokes.s2(r, c)};
        StokesCovariance v = stokes_covariance(variance.i0(r, c), variance.i45(r, c),
                                               variance.i90(r, c), variance.i135(r, c));
        v.s0s0 *= 1 + 3 * shared;
        v.s1s1 *= 1 - shared;
        v.s2s2 *= 1 - shared;
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
        out.aolp_sd_deg(r, c) = static_cast<float>(std::sqrt(aolp_variance_deg2(s, v)));
        out.dolp_corrected(r, c) = static_cast<float>(
            intensities == Intensities::kMeasured ? corrected_dolp(s, v) : expected_dolp(s, v));
      }
  });
  return out;
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
                            angle_variances(packed_variance, layout, {colors[i]}, intensities),
                            intensities));
  return all;
}

std::vector<StokesUncertainty> uncertainty_of(const StokesPicture& picture,
                                              const Planes& packed_variance,
                                              const SensorLayout& layout, Intensities intensities) {
  std::vector<StokesUncertainty> all;
  for (std::size_t i = 0; i < picture.planes.size(); ++i) {
    std::vector<Color> merged;
    for (Color color : layout.colors())
      if (display_name(color) == picture.names[i]) merged.push_back(color);
    all.push_back(propagate(picture.planes[i],
                            angle_variances(packed_variance, layout, merged, intensities),
                            intensities));
  }
  return all;
}

}  // namespace malus
