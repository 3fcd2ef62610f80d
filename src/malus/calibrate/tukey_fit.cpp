#include "malus/calibrate/internal/tukey_fit.h"

#include "malus/base/golden_section.h"
#include "malus/noise/tukey_lambda.h"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr double kFewestSamples = 200;

double log_likelihood(const ResidualHistogram& histogram, const std::vector<double>& log_density) {
  double sum = 0.0;
  for (std::size_t i = 0; i < log_density.size(); ++i)
    sum += histogram.cells()[i].count * log_density[i];
  return sum;
}

double blur_variance_dn2(const ResidualHistogram& histogram, const ResidualBlur& blur) {
  const double q = blur.quantization_dn, h = histogram.cell_dn();
  return (q * q + h * h) / 12.0 + blur.offset_variance_dn2;
}

// Scale that reproduces the residuals' variance at a given λ; at least a little above zero, so that
// a search can start from it.
double scale_from_variance(const ResidualHistogram& histogram, const ResidualBlur& blur,
                           double lambda) {
  const double total = histogram.mean_square_dn2();
  const double read = std::max(total - blur_variance_dn2(histogram, blur), 0.05 * total);
  return std::sqrt(read / tukey_lambda_variance(lambda));
}

std::string refusal(const ResidualHistogram& histogram, double fewest = kFewestSamples) {
  if (histogram.count() < fewest)
    return fmt::format("{:.0f} samples are too few for a shape; {:.0f} are needed",
                       histogram.count(), fewest);
  if (histogram.cells().size() < 3)
    return "the dark pixels have too few different values: noise far below one step";
  return {};
}

struct Point {
  double lambda, log_scale, value;
};

// Newton's method on a smooth function of two variables with numeric derivatives; steps that do not
// climb are halved.
template <class Function>
Point climb(const Function& f, Point best) {
  constexpr double kDelta = 1e-3;
  for (int iteration = 0; iteration < 30; ++iteration) {
    const double l = best.lambda, s = best.log_scale, f0 = best.value;
    const double lp = f(l + kDelta, s), lm = f(l - kDelta, s), sp = f(l, s + kDelta),
                 sm = f(l, s - kDelta);
    const double gl = (lp - lm) / (2 * kDelta), gs = (sp - sm) / (2 * kDelta);
    double hll = (lp - 2 * f0 + lm) / (kDelta * kDelta);
    double hss = (sp - 2 * f0 + sm) / (kDelta * kDelta);
    const double hls =
        (f(l + kDelta, s + kDelta) - lp - sp + 2 * f0 - lm - sm + f(l - kDelta, s - kDelta)) /
        (2 * kDelta * kDelta);
    double det = hll * hss - hls * hls;
    double dl, ds;
    if (hll < 0 && det > 0) {
      dl = -(hss * gl - hls * gs) / det;
      ds = -(hll * gs - hls * gl) / det;
    } else {  // not concave here: go along the gradient
      const double norm = std::hypot(gl, gs);
      dl = 0.05 * gl / norm;
      ds = 0.05 * gs / norm;
    }
    const double longest = std::max({std::abs(dl) / 0.2, std::abs(ds) / 0.3, 1.0});
    dl /= longest;
    ds /= longest;
    bool climbed = false;
    for (int halving = 0; halving < 12 && !climbed; ++halving, dl *= 0.5, ds *= 0.5) {
      const double next_l = std::clamp(l + dl, kLambdaLow, kLambdaHigh), next_s = s + ds;
      const double value = f(next_l, next_s);
      if (value > f0) {
        best = {next_l, next_s, value};
        climbed = true;
      }
    }
    if (!climbed || std::hypot(best.lambda - l, best.log_scale - s) < 1e-7) break;
  }
  return best;
}

// Derivatives of the log-density by λ and ln scale at every cell: the scores.
struct Scores {
  std::vector<double> lambda, scale;
};

Scores scores_at(const CellDensity& density, double lambda, double log_scale) {
  constexpr double kDelta = 1e-3;
  const auto lp = density.log_density(lambda + kDelta, log_scale),
             lm = density.log_density(lambda - kDelta, log_scale),
             sp = density.log_density(lambda, log_scale + kDelta),
             sm = density.log_density(lambda, log_scale - kDelta);
  Scores scores{lp, sp};
  for (std::size_t i = 0; i < lp.size(); ++i) {
    scores.lambda[i] = (lp[i] - lm[i]) / (2 * kDelta);
    scores.scale[i] = (sp[i] - sm[i]) / (2 * kDelta);
  }
  return scores;
}

using Symmetric = std::array<double, 3>;  // aa, ab, bb

Symmetric inverse_of(const Symmetric& m) {
  const double det = m[0] * m[2] - m[1] * m[1];
  return {m[2] / det, -m[1] / det, m[0] / det};
}

// a b a.
Symmetric sandwich(const Symmetric& a, const Symmetric& b) {
  const double p = a[0] * b[0] + a[1] * b[1], q = a[0] * b[1] + a[1] * b[2],
               r = a[1] * b[0] + a[2] * b[1], s = a[1] * b[1] + a[2] * b[2];
  return {p * a[0] + q * a[1], p * a[1] + q * a[2], r * a[1] + s * a[2]};
}

// Mean outer product of the scores.
Symmetric scatter_of(const Scores& scores, const ResidualHistogram& histogram) {
  Symmetric out{};
  const auto n = histogram.count();
  for (std::size_t i = 0; i < scores.lambda.size(); ++i) {
    const double weight = histogram.cells()[i].count / n;
    out[0] += weight * scores.lambda[i] * scores.lambda[i];
    out[1] += weight * scores.lambda[i] * scores.scale[i];
    out[2] += weight * scores.scale[i] * scores.scale[i];
  }
  return out;
}

// Minus the mean derivative of the scores.
Symmetric curvature_of(const CellDensity& density, const Point& at,
                       const ResidualHistogram& histogram) {
  constexpr double kDelta = 3e-3;
  const Scores lp = scores_at(density, at.lambda + kDelta, at.log_scale),
               lm = scores_at(density, at.lambda - kDelta, at.log_scale),
               sp = scores_at(density, at.lambda, at.log_scale + kDelta),
               sm = scores_at(density, at.lambda, at.log_scale - kDelta);
  Symmetric out{};
  const auto n = histogram.count();
  for (std::size_t i = 0; i < lp.lambda.size(); ++i) {
    const double weight = histogram.cells()[i].count / n / (2 * kDelta);
    out[0] -= weight * (lp.lambda[i] - lm.lambda[i]);
    out[1] -= weight * 0.5 * (lp.scale[i] - lm.scale[i] + sp.lambda[i] - sm.lambda[i]);
    out[2] -= weight * (sp.scale[i] - sm.scale[i]);
  }
  return out;
}

// What the errors follow from: the curvature where noise is not quite Tukey-lambda, too. At λ near
// one half it may not be seen (the support's end decides); then the scores' scatter stands for it.
void fill_errors(const CellDensity& density, const Point& best, const ResidualHistogram& histogram,
                 TukeyFit& fit) {
  const Symmetric scatter = scatter_of(scores_at(density, best.lambda, best.log_scale), histogram);
  const Symmetric curvature = curvature_of(density, best, histogram);
  const bool concave =
      curvature[0] > 0 && curvature[0] * curvature[2] > curvature[1] * curvature[1];
  fit.unit_step = inverse_of(concave ? curvature : scatter);
  fit.unit_covariance = sandwich(fit.unit_step, scatter);
}

// Mean of the scale-1 quantile function over u in (a, b), both above one half:
// the integral of Q is (u^(λ+1) + (1-u)^(λ+1)) / (λ (λ+1)).
double mean_quantile(double a, double b, double lambda) {
  if (std::abs(lambda) < 1e-4) lambda = 1e-4;  // the limit, to 1e-8
  const auto integral = [lambda](double u) {
    return (std::pow(u, lambda + 1.0) + std::pow(1.0 - u, lambda + 1.0)) /
           (lambda * (lambda + 1.0));
  };
  return (integral(b) - integral(a)) / (b - a);
}

struct Plot {
  double correlation, slope;
};

// Probability plot of the folded residuals; by symmetry the means are zero.
Plot probability_plot(const ResidualHistogram& histogram, double lambda) {
  double below = 0.0, xx = 0.0, xy = 0.0, yy = 0.0;
  const auto n = histogram.count();
  for (const auto& cell : histogram.cells()) {
    const double a = 0.5 + 0.5 * below / n;
    below += cell.count;
    const double x = mean_quantile(a, 0.5 + 0.5 * below / n, lambda);
    const double y = histogram.centre_dn(cell);
    xx += cell.count * x * x;
    xy += cell.count * x * y;
    yy += cell.count * y * y;
  }
  return {xy / std::sqrt(xx * yy), xy / xx};
}

}  // namespace

Estimate<TukeyFit> fit_tukey_lambda_ppcc(const ResidualHistogram& histogram,
                                         const ResidualBlur& blur) {
  if (const std::string reason = refusal(histogram, 30); !reason.empty()) return Undecided{reason};
  constexpr int kSections = 27;  // to 1e-5 of lambda
  TukeyFit fit;
  fit.lambda = golden_section_minimum(  // the correlation has one maximum
      [&](double lambda) { return -probability_plot(histogram, lambda).correlation; }, kLambdaLow,
      kLambdaHigh, kSections);
  const double slope = probability_plot(histogram, fit.lambda).slope;
  const double read =
      slope * slope - blur_variance_dn2(histogram, blur) / tukey_lambda_variance(fit.lambda);
  if (!(read > 0)) return Undecided{"the read noise is hidden below the converter's step"};
  fit.scale_dn = std::sqrt(read);
  return fit;
}

Estimate<TukeyFit> fit_tukey_lambda(const ResidualHistogram& histogram, const ResidualBlur& blur) {
  if (const std::string reason = refusal(histogram); !reason.empty()) return Undecided{reason};
  const CellDensity density(histogram, blur);
  const auto value = [&](double lambda, double log_scale) {
    return log_likelihood(histogram, density.log_density(lambda, log_scale));
  };
  Point best{0, 0, -std::numeric_limits<double>::infinity()};
  for (const double lambda : {-0.35, -0.2, -0.1, 0.0, 0.1, 0.2, 0.35, 0.6, 0.9}) {
    const double log_scale = std::log(scale_from_variance(histogram, blur, lambda));
    const double found = value(lambda, log_scale);
    if (found > best.value) best = {lambda, log_scale, found};
  }
  best = climb(value, best);
  if (best.lambda <= kLambdaLow + 0.005 || best.lambda >= kLambdaHigh - 0.005)
    return Undecided{fmt::format("the best λ, {:.2f}, lies at the end of the range {} to {}",
                                 best.lambda, kLambdaLow, kLambdaHigh)};
  TukeyFit fit;
  fit.lambda = best.lambda;
  fit.scale_dn = std::exp(best.log_scale);
  fill_errors(density, best, histogram, fit);
  return fit;
}

FrameShapes::FrameShapes(const TukeyFit& fit, const ResidualHistogram& pooled,
                         const ResidualBlur& blur)
    : fit_(fit) {
  const CellDensity density(pooled, blur);
  Scores scores = scores_at(density, fit.lambda, std::log(fit.scale_dn));
  for (const auto& cell : pooled.cells()) index_.push_back(cell.index);
  lambda_score_ = std::move(scores.lambda);
  scale_score_ = std::move(scores.scale);
}

FrameShapes::Shape FrameShapes::of(const ResidualHistogram& frame) const {
  double lambda = 0.0, scale = 0.0;
  std::size_t i = 0;
  for (const auto& cell : frame.cells()) {
    while (index_[i] < cell.index) ++i;
    lambda += cell.count * lambda_score_[i];
    scale += cell.count * scale_score_[i];
  }
  const auto n = frame.count();
  const auto& c = fit_.unit_step;
  return {fit_.lambda + (c[0] * lambda + c[1] * scale) / n,
          std::log(fit_.scale_dn) + (c[1] * lambda + c[2] * scale) / n};
}

}  // namespace malus
