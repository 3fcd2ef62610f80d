#include "malus/noise/data_sheet.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/noise/rounding.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <functional>
#include <limits>

#include <unsupported/Eigen/FFT>

namespace malus {
namespace {

constexpr double kNone = std::numeric_limits<double>::quiet_NaN();

double at(const std::vector<double>& values, std::size_t channel) {
  return channel < values.size() ? values[channel] : kNone;
}

// value / K with the errors of both.
struct Ratio {
  double value, error;
};
Ratio in_electrons(double value, double error, double K, double K_error) {
  const double ratio = value / K;
  return {ratio, std::hypot(error / K, ratio * K_error / K)};
}

// EMVA 1288, "temporal dark noise": σ_d² = (σ_y.dark² - σ_q²) / K², σ_q² = q²/12. Where the
// converter's step hides the noise the standard gives the limit, without an error.
double least_dark_variance_dn2(double step_dn) { return kLeastDarkVariance * step_dn * step_dn; }
Ratio dark_noise_e(double sd_dn, double sd_error_dn, double quantization_dn, double K,
                   double K_error) {
  const double step2 = quantization_dn * quantization_dn;
  const double variance = sd_dn * sd_dn;
  if (const double least = least_dark_variance_dn2(quantization_dn); variance < least)
    return {std::sqrt(least - step2 / 12) / K, kNone};
  const double own_dn = std::sqrt(variance - step2 / 12);
  return in_electrons(own_dn, own_dn > 0 ? sd_error_dn * sd_dn / own_dn : sd_error_dn, K, K_error);
}

// EMVA 1288 eq. for the absolute sensitivity threshold, where the SNR is one. Rounding is part of
// what light must top: the dark noise is the whole one, at least the standard's limit.
double threshold_e(double sd_dn, double quantization_dn, double K) {
  const double dark_noise_e =
      std::sqrt(std::max(sd_dn * sd_dn, least_dark_variance_dn2(quantization_dn))) / K;
  return std::sqrt(dark_noise_e * dark_noise_e + 0.25) + 0.5;
}

std::vector<double> spectrum(int lines, int length, const std::function<float(int, int)>& value) {
  if (lines == 0 || length == 0) return {};
  const auto bins = static_cast<std::size_t>(length / 2 + 1);
  using Sum = std::vector<double>;
  constexpr int kGrain = 64;
  const Sum power = parallel_reduce(
      0, lines, kGrain, Sum(bins, 0.0),
      [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
        Sum sum(bins, 0.0);
        Eigen::FFT<double> fft;
        std::vector<double> line(static_cast<std::size_t>(length));
        std::vector<std::complex<double>> transform;
        for (auto r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
          for (int c = 0; c < length; ++c)
            line[static_cast<std::size_t>(c)] = static_cast<double>(value(r, c));
          if (length > 1)
            fft.fwd(transform, line);
          else
            transform.assign(1, line[0]);  // the transform takes no less than two
          for (std::size_t k = 0; k < bins; ++k) sum[k] += std::norm(transform[k]);
        }
        return sum;
      },
      [](Sum total, const Sum& part) {
        for (std::size_t k = 0; k < total.size(); ++k) total[k] += part[k];
        return total;
      });
  Sum amplitude;
  for (const double p : power)
    amplitude.push_back(std::sqrt(p / (static_cast<double>(lines) * static_cast<double>(length))));
  return amplitude;
}

// As data_sheet says it.
bool saturation_is_known(const PhysicsCalibration& p, int channel) {
  bool any_below_white = false;
  for (const PhotonTransferPoint& point : p.transfer) {
    if (point.channel == channel && (point.saturated || point.at_white)) return true;
    any_below_white = any_below_white || point.saturated;
  }
  return !any_below_white;
}

}  // namespace

// EMVA 1288, "saturation capacity": where the variance has its maximum. The first level past it is
// nearer to a hard end than the last one before. Light is what lies above the dark signal, whatever
// black level was declared.
double saturation_level_dn(const NoiseModel& model, const PhysicsCalibration& p, int channel) {
  const auto c = static_cast<std::size_t>(channel);
  const double dark_dn = at(p.mu.mean, c);
  double saturation =
      model.white_dn - at(model.black_dn, c) - (std::isfinite(dark_dn) ? dark_dn : 0.0);
  for (const PhotonTransferPoint& point : p.transfer)
    if (point.channel == channel && point.saturated)
      saturation = std::min(saturation, point.mean_dn);
  return saturation;
}

bool counts_for_linearity(const PhotonTransferPoint& point, double saturation_dn) {
  return !point.at_white && point.exposure_s > 0 && point.mean_dn >= 0.05 * saturation_dn &&
         point.mean_dn <= 0.95 * saturation_dn;
}

bool exposure_tells_light(const std::vector<PhotonTransferPoint>& transfer, int channel,
                          double saturation_dn) {
  constexpr double kSameExposure = 1e-3, kSameLight = 0.02;  // relative
  std::vector<const PhotonTransferPoint*> points;
  for (const PhotonTransferPoint& point : transfer)
    if (point.channel == channel && counts_for_linearity(point, saturation_dn))
      points.push_back(&point);
  const auto differ = [](double a, double b, double share) {
    return std::abs(a - b) > share * std::max(a, b);
  };
  for (std::size_t i = 0; i < points.size(); ++i)
    for (std::size_t k = 0; k < i; ++k)
      if (!differ(points[i]->exposure_s, points[k]->exposure_s, kSameExposure) &&
          differ(points[i]->mean_dn, points[k]->mean_dn, kSameLight))
        return false;
  return true;
}

std::optional<LineFit> linearity_line(const std::vector<PhotonTransferPoint>& transfer, int channel,
                                      double saturation_dn) {
  std::vector<double> exposure, signal, weight;
  for (const PhotonTransferPoint& point : transfer) {
    if (point.channel != channel || !counts_for_linearity(point, saturation_dn)) continue;
    exposure.push_back(point.exposure_s);
    signal.push_back(point.mean_dn);
    weight.push_back(1 / (point.mean_dn * point.mean_dn));
  }
  std::vector<double> distinct = exposure;
  std::sort(distinct.begin(), distinct.end());
  distinct.erase(std::unique(distinct.begin(), distinct.end()), distinct.end());
  if (distinct.size() < 3 || !exposure_tells_light(transfer, channel, saturation_dn))
    return std::nullopt;
  return fit_line(exposure, signal, weight);
}

double linearity_error_percent(const std::vector<PhotonTransferPoint>& transfer, int channel,
                               double saturation_dn) {
  const std::optional<LineFit> line = linearity_line(transfer, channel, saturation_dn);
  if (!line) return kNone;
  double deviation = 0, count = 0;
  for (const PhotonTransferPoint& point : transfer) {
    if (point.channel != channel || !counts_for_linearity(point, saturation_dn)) continue;
    const double expected = line->intercept + line->slope * point.exposure_s;
    deviation += std::abs(point.mean_dn - expected) / expected;
    ++count;
  }
  return 100 * deviation / count;
}

double transfer_intercept_dn2(const PhysicsCalibration& p, int channel) {
  const auto c = static_cast<std::size_t>(channel);
  if (c < p.line_intercept_dn2.size()) return p.line_intercept_dn2[c];
  const bool cut_off =
      !p.cut_off_undone && c < p.dark_zero_share.size() && p.dark_zero_share[c] > kMostDarkZeros;
  return cut_off ? at(p.K_intercept_dn2, c) : 0;
}

TransferMisfit transfer_misfit(const PhysicsCalibration& p, int channel) {
  TransferMisfit misfit;
  const double intercept = transfer_intercept_dn2(p, channel);
  const double K = at(p.K.mean, static_cast<std::size_t>(channel));
  for (const PhotonTransferPoint& point : p.transfer) {
    if (point.channel != channel || !point.used || !(point.variance_stderr_dn2 > 0)) continue;
    const double off_dn2 = point.variance_dn2 - intercept - K * point.mean_dn;
    misfit.chi_square += std::pow(off_dn2 / point.variance_stderr_dn2, 2);
    ++misfit.degrees_of_freedom;
  }
  const int parameters = intercept != 0 ? 2 : 1;
  misfit.degrees_of_freedom = std::max(misfit.degrees_of_freedom - parameters, 0);
  return misfit;
}

double signal_to_noise(double signal, double dark_noise) {
  return signal / std::sqrt(dark_noise * dark_noise + signal);
}

ChannelMean channel_mean(const Quantity& quantity) {
  const bool shared = quantity.name == "temporal_dark_noise" || quantity.name == "dark_signal" ||
                      quantity.name == "dsnu";
  Moments values;
  double errors = 0, squares = 0;
  for (std::size_t c = 0; c < quantity.value.size(); ++c) {
    if (!std::isfinite(quantity.value[c])) continue;
    values.add(quantity.value[c]);
    const double error = at(quantity.standard_error, c);
    errors += error;
    squares += error * error;
  }
  if (values.count() == 0) return {kNone, kNone};
  return {values.mean(),
          (shared ? errors : std::sqrt(squares)) / static_cast<double>(values.count())};
}

std::vector<Quantity> data_sheet(const NoiseModel& model, const PhysicsCalibration& p) {
  const std::vector<double> read_e = read_noise_e(p), read_error = read_noise_stderr_e(p);
  Quantity K{"overall_gain", "K", "DN/e-", "overall system gain", {}, {}};
  Quantity dark{
      "temporal_dark_noise", "σ_d", "e-", "temporal dark noise, quantization taken off", {}, {}};
  Quantity read{"read_noise", "σ_read", "e-", "read noise without row noise", {}, {}};
  Quantity bias{"dark_signal", "μ", "DN", "dark signal above black", {}, {}};
  Quantity dsnu{"dsnu", "DSNU", "e-", "dark signal non-uniformity, defects left out", {}, {}};
  Quantity prnu{"prnu", "PRNU", "%", "photo response non-uniformity, defects left out", {}, {}};
  Quantity full{"saturation", "μ_sat", "e-", "saturation capacity", {}, {}};
  Quantity least{"threshold", "μ_min", "e-", "absolute sensitivity threshold", {}, {}};
  Quantity range{"dynamic_range", "DR", "dB", "dynamic range", {}, {}};
  Quantity snr{"snr_max", "SNR_max", "dB", "largest signal-to-noise ratio", {}, {}};
  Quantity linear{"linearity_error", "LE", "%", "linearity error", {}, {}};
  for (int channel = 0; channel < model.layout.channels(); ++channel) {
    const auto c = static_cast<std::size_t>(channel);
    const double gain = at(p.K.mean, c), gain_error = at(p.K.standard_error, c);
    const double reach_dn = saturation_level_dn(model, p, channel);
    const double dark_dn = at(p.temporal_sd_dark_dn, c);
    const auto [dark_e, dark_error] = dark_noise_e(dark_dn, at(p.temporal_sd_dark_stderr_dn, c),
                                                   model.quantization_dn, gain, gain_error);
    const auto [full_e, full_error] =
        in_electrons(saturation_is_known(p, channel) ? reach_dn : kNone, 0, gain, gain_error);
    const double limit_e = threshold_e(dark_dn, model.quantization_dn, gain);
    K.value.push_back(gain);
    K.standard_error.push_back(gain_error);
    dark.value.push_back(dark_e);
    dark.standard_error.push_back(dark_error);
    read.value.push_back(at(read_e, c));
    read.standard_error.push_back(at(read_error, c));
    bias.value.push_back(at(p.mu.mean, c));
    bias.standard_error.push_back(at(p.mu.standard_error, c));
    dsnu.value.push_back(at(p.dsnu_dn, c) / gain);
    if (!p.dsnu_stderr_dn.empty()) {
      const auto [dsnu_e, error] =
          in_electrons(at(p.dsnu_dn, c), at(p.dsnu_stderr_dn, c), gain, gain_error);
      dsnu.standard_error.push_back(error);
    }
    prnu.value.push_back(100 * at(p.prnu, c));
    if (!p.prnu_stderr.empty()) prnu.standard_error.push_back(100 * at(p.prnu_stderr, c));
    full.value.push_back(full_e);
    full.standard_error.push_back(full_error);
    least.value.push_back(limit_e);
    range.value.push_back(20 * std::log10(full_e / limit_e));
    snr.value.push_back(10 * std::log10(full_e));  // shot noise alone: SNR = sqrt(electrons)
    linear.value.push_back(linearity_error_percent(p.transfer, channel, reach_dn));
  }
  return {K, dark, read, bias, dsnu, prnu, full, least, range, snr, linear};
}

std::vector<double> row_profile(View<const float> map) {
  std::vector<double> profile;
  for (int r = 0; r < map.rows(); ++r) {
    double sum = 0;
    for (const float value : map.row_span(r)) sum += static_cast<double>(value);
    profile.push_back(sum / map.cols());
  }
  return profile;
}

std::vector<double> column_profile(View<const float> map) {
  std::vector<double> profile(static_cast<std::size_t>(map.cols()), 0.0);
  for (int r = 0; r < map.rows(); ++r)
    for (int c = 0; c < map.cols(); ++c)
      profile[static_cast<std::size_t>(c)] += static_cast<double>(map(r, c));
  for (double& value : profile) value /= map.rows();
  return profile;
}

std::vector<double> row_spectrum(View<const float> map) {
  return spectrum(map.rows(), map.cols(), [&](int r, int c) { return map(r, c); });
}

std::vector<double> column_spectrum(View<const float> map) {
  return spectrum(map.cols(), map.rows(), [&](int c, int r) { return map(r, c); });
}

}  // namespace malus
