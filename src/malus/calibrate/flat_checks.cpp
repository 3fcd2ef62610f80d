#include "malus/calibrate/internal/flat_checks.h"

#include "malus/base/statistics.h"
#include "malus/base/text.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

// Of several levels with one trouble the worst is named.
std::string and_more(int levels) {
  return levels > 1 ? fmt::format(" (as do {} more)", levels - 1) : "";
}

void warn_of_flats_below_dark(const std::vector<FlatObservation>& flats,
                              const FlatReference& reference, PhysicsCalibration& out) {
  constexpr double kOfNoise = 0.5, kStandardErrors = 8.0;
  constexpr double kOfStep = 1e-3;  // means of frames without any noise are only rounded
  const FlatObservation* lowest = nullptr;
  int levels = 0;
  for (const FlatObservation& flat : flats) {
    const double frames = static_cast<double>(flat.signal_dn.size());
    const double error =
        reference.frame_sd_dn * std::sqrt(1.0 / frames + 1.0 / std::max(reference.bias_frames, 1));
    const double least = std::max(
        {kOfNoise * reference.dark_sd_dn, kStandardErrors * error, kOfStep * reference.step_dn});
    const double signal = mean_of(flat.signal_dn);
    if (!(signal < -least)) continue;
    ++levels;
    if (!lowest || signal < mean_of(lowest->signal_dn)) lowest = &flat;
  }
  if (lowest)
    out.warnings.push_back(fmt::format(
        "{} ({}) lies {:.4g} DN below the dark frames{}: are dark and flat frames exchanged?",
        lowest->name, lowest->sources.front(), -mean_of(lowest->signal_dn), and_more(levels)));
}

void warn_of_mixed_light(const std::vector<FlatObservation>& flats, const FlatReference& reference,
                         PhysicsCalibration& out) {
  constexpr double kOfLight = 0.1, kStandardErrors = 8.0;
  const double dark = reference.dark_sd_dn + kStandardErrors * reference.frame_sd_dn;
  const FlatObservation* worst = nullptr;
  double most = 0;
  int levels = 0;
  for (const FlatObservation& flat : flats) {
    const auto [low, high] = std::minmax_element(flat.signal_dn.begin(), flat.signal_dn.end());
    const double difference = *high - *low, light = mean_of(flat.signal_dn);
    if (!(difference > std::max(kOfLight * light, dark))) continue;
    ++levels;
    if (worst && !(difference / std::max(light, dark) > most)) continue;
    most = difference / std::max(light, dark);
    worst = &flat;
  }
  if (!worst) return;
  const auto [low, high] = std::minmax_element(worst->signal_dn.begin(), worst->signal_dn.end());
  const auto source = [&](auto frame) {
    return worst->sources[static_cast<std::size_t>(frame - worst->signal_dn.begin())];
  };
  out.warnings.push_back(fmt::format(
      "{}: its frames run from {:.4g} DN of light ({}) to {:.4g} DN ({}){}: does the lamp flicker? "
      "That does no harm; but if these are several exposures or light levels, give the frames of "
      "each their own [[frames]], with `level`",
      worst->name, *low, source(low), *high, source(high), and_more(levels)));
}

void warn_of_unlike_frames(const std::vector<FlatObservation>& flats, PhysicsCalibration& out) {
  const FlatObservation* first = nullptr;
  int levels = 0;
  for (const FlatObservation& flat : flats) {
    if (flat.unlike.empty()) continue;
    ++levels;
    if (!first) first = &flat;
  }
  if (!first) return;
  const std::size_t more = first->unlike.size() - 1;
  out.warnings.push_back(fmt::format(
      "{}: {}{} is left out, with {:.4g} DN of light where the others have {:.4g} DN{}: did the "
      "lamp or the exposure come late?",
      first->name, first->unlike.front(), more > 0 ? fmt::format(" (and {} more)", more) : "",
      first->unlike_dn, mean_of(first->signal_dn),
      levels > 1 ? fmt::format(" (as are frames of {} more levels)", levels - 1) : ""));
}

void warn_of_low_white(const std::vector<FlatObservation>& flats, const FlatReference& reference,
                       PhysicsCalibration& out) {
  constexpr double kOfPixels = 1e-3;
  const FlatObservation* most = nullptr;
  const auto share = [](const FlatObservation& flat) {
    return static_cast<double>(flat.above_white) / static_cast<double>(flat.pixels);
  };
  for (const FlatObservation& flat : flats)
    if (share(flat) > kOfPixels && (!most || share(flat) > share(*most))) most = &flat;
  float largest = 0;
  for (const FlatObservation& flat : flats) largest = std::max(largest, flat.codes.largest());
  if (most)
    out.warnings.push_back(
        fmt::format("{:.3g} % of the pixels of {} lie above white = {:g} DN, the largest code of "
                    "all flats is {:g} DN: white is too low, correct it in [sensor]",
                    100 * share(*most), most->name, reference.white_dn, largest));
}

// Photons spread over many codes: that most pixels of a bright level have the largest one, and next
// to none the code below it, is the converter's end.
void warn_of_high_white(const std::vector<FlatObservation>& flats, const FlatReference& reference,
                        PhysicsCalibration& out) {
  constexpr double kOfPixels = 0.01, kOfNext = 10, kAboveNoise = 20;
  float largest = -1e30F;
  for (const FlatObservation& flat : flats)
    if (!flat.codes.empty()) largest = std::max(largest, flat.codes.largest());
  if (!(largest < reference.white_dn) ||
      !(largest - reference.black_dn > kAboveNoise * reference.dark_sd_dn))
    return;
  const FlatObservation* most = nullptr;
  double most_share = 0;
  for (const FlatObservation& flat : flats) {
    if (flat.codes.largest() != largest) continue;
    const auto count = static_cast<double>(flat.codes.at_largest());
    const double share = count / static_cast<double>(flat.pixels);
    if (share < kOfPixels || count < kOfNext * static_cast<double>(flat.codes.at_next())) continue;
    if (share > most_share) most = &flat;
    most_share = std::max(most_share, share);
  }
  if (most)
    out.warnings.push_back(fmt::format(
        "the brightest flats pile up at {0:g} DN ({1:.3g} % of the pixels of {2}), below "
        "white = {3:g} DN: they are saturated there, give white = {0:g} in [sensor]",
        largest, 100 * most_share, most->name, reference.white_dn));
}

// Rounding to codes that grow like the root of the light has a variance that grows like it: K was
// 4 % too large at 20 standard errors.
void warn_of_companding(const std::vector<FlatObservation>& flats, PhysicsCalibration& out) {
  constexpr double kWider = 1.5, kOfVariance = 0.01;
  const FlatObservation *finest = nullptr, *worst = nullptr;
  const auto spacing_dn = [](const FlatObservation& flat) {
    return flat.code_spacing_dn.empty() ? 0.0 : flat.code_spacing_dn.front();
  };
  for (const FlatObservation& flat : flats)
    if (spacing_dn(flat) > 0 && (!finest || spacing_dn(flat) < spacing_dn(*finest))) finest = &flat;
  if (!finest) return;
  const auto share = [&](const FlatObservation& flat) {
    return spacing_dn(flat) * spacing_dn(flat) / 12.0 / flat.variance_dn2;
  };
  for (const FlatObservation& flat : flats)
    if (flat.variance_dn2 > 0 && spacing_dn(flat) > kWider * spacing_dn(*finest) &&
        share(flat) > kOfVariance && (!worst || share(flat) > share(*worst)))
      worst = &flat;
  if (!worst) return;
  out.warnings.push_back(fmt::format(
      "codes lie {:.3g} DN apart at {:.4g} DN of light and {:.3g} DN at {:.4g} DN: the files are "
      "companded or compressed with loss, and their rounding, {:.2g} % of the variance there, "
      "counts in K; record linear frames without loss",
      spacing_dn(*worst), mean_of(worst->signal_dn), spacing_dn(*finest),
      mean_of(finest->signal_dn), 100 * share(*worst)));
}

void warn_of_changing_light(const std::vector<FlatObservation>& flats,
                            const FlatReference& reference, PhysicsCalibration& out) {
  constexpr double kOfVariance = 0.01, kErrors = 6.0;
  const FlatObservation* worst = nullptr;
  double most = 0;
  const char* direction = "";
  // Row noise is taken off as a band of one group has it. Of so few draws it scatters itself.
  const auto judge = [&](const FlatObservation& flat, double change, double pixels_error,
                         double lines_dn2, double draws, const char* way) {
    change -= lines_dn2;
    const double freedom = draws * (static_cast<double>(flat.signal_dn.size()) - 1.0);
    const double error = pixels_error + lines_dn2 * std::sqrt(2.0 / freedom);
    const double share = change / flat.mean_variance_dn2;
    if (!(share > std::max(kOfVariance, most)) || !(change > kErrors * error)) return;
    worst = &flat;
    most = share;
    direction = way;
  };
  for (const FlatObservation& flat : flats) {
    if (!(flat.mean_variance_dn2 > 0)) continue;
    const LightChange& light = flat.light;
    judge(flat, light.rows_dn2, light.rows_stderr_dn2, reference.row_variance_dn2,
          std::min<double>(light.row_bands, reference.row_groups), "down");
    judge(flat, light.columns_dn2, light.columns_stderr_dn2, reference.column_variance_dn2,
          light.column_bands, "across");
  }
  if (!worst) return;
  const double light = mean_of(worst->signal_dn);
  const double change_dn = std::sqrt(most * worst->mean_variance_dn2);
  // Of next to no light a share says nothing.
  const std::string much = change_dn < light ? percent_text(change_dn / light) + " %"
                                             : fmt::format("{:.3g} DN", change_dn);
  out.warnings.push_back(fmt::format(
      "{}: the light changes by {} {} the frame, from frame to frame, which is {} % of the "
      "temporal variance and counts in K: mains flicker under a rolling shutter, a lamp that "
      "moves, or frames with lost parts",
      worst->name, much, direction, percent_text(std::min(most, 1.0))));
}

// That of codes which the brighter half of the flats has alike, though the few of dim ones and of
// the dark may lie between two gaps; else the finest of all, or companded ones were taken for
// scaled.
double scaled_spacing(const std::vector<FlatObservation>& flats, std::size_t channel, double dark) {
  constexpr double kAlike = 1.05;
  constexpr std::ptrdiff_t kFewest = 3;
  std::vector<std::pair<double, double>> of_light;  // rising, with the spacing
  for (const FlatObservation& flat : flats)
    if (channel < flat.code_spacing_dn.size() && flat.code_spacing_dn[channel] > 0)
      of_light.emplace_back(mean_of(flat.signal_dn), flat.code_spacing_dn[channel]);
  std::sort(of_light.begin(), of_light.end());
  const auto finer = [](const auto& a, const auto& b) { return a.second < b.second; };
  const auto half = of_light.begin() + static_cast<std::ptrdiff_t>(of_light.size() / 2);
  if (of_light.end() - half >= kFewest) {
    const auto [least, most] = std::minmax_element(half, of_light.end(), finer);
    if (most->second < kAlike * least->second) return least->second;
  }
  if (of_light.empty()) return dark;
  const double least = std::min_element(of_light.begin(), of_light.end(), finer)->second;
  return dark > 0 ? std::min(least, dark) : least;
}

// Of which all values of a channel are multiples, dark and lit; 0: not whole numbers.
double common_step(const std::vector<FlatObservation>& flats, std::size_t channel, double dark) {
  auto step = static_cast<std::int64_t>(dark);
  for (const FlatObservation& flat : flats)
    if (channel < flat.code_step_dn.size())
      step = std::gcd(step, static_cast<std::int64_t>(flat.code_step_dn[channel]));
  return static_cast<double>(step);
}

struct ScaledCodes {
  double spacing_dn = 0, of_dark = 0;  ///< its rounding's share of the dark variance
  const ChannelCodes* channel = nullptr;
};

ScaledCodes scaled_codes(const std::vector<FlatObservation>& flats, std::size_t channel,
                         const ChannelCodes& codes, double dark_sd_dn) {
  constexpr double kWider = 1.02, kOfVariance = 0.001, kOfPeriod = 0.5;
  const double spacing = scaled_spacing(flats, channel, codes.spacing_dn);
  const double step = common_step(flats, channel, codes.step_dn), dark = dark_sd_dn * dark_sd_dn;
  if (!(step > 0) || !(spacing > kWider * step)) return {};
  const double hidden = (spacing * spacing - step * step) / 12.0;
  // As far apart lie the codes that do not occur: where narrower noise lies decides what it shows.
  const double period = step * spacing / (spacing - step);
  if (!(hidden > kOfVariance * dark) && !(dark_sd_dn < kOfPeriod * period)) return {};
  return {spacing, spacing * spacing / 12.0 / dark, &codes};
}

void warn_of_left_out_code(const FlatReference& reference, PhysicsCalibration& out) {
  constexpr double kOfStep = 0.5;  // narrower noise about two levels may leave the code between out
  for (std::size_t c = 0; c < reference.codes.size(); ++c) {
    const ChannelCodes& codes = reference.codes[c];
    if (!codes.left_out_dn || !(out.temporal_sd_dark_dn[c] > kOfStep * codes.step_dn)) continue;
    out.warnings.push_back(fmt::format(
        "{}no dark pixel has the code {:g}, though both codes beside it have many: the converter "
        "leaves it out, or values were multiplied by little more than 1 after the conversion. What "
        "is measured in the dark (σ_TL, λ, σ_b, DSNU) may be far off; K hardly is. Set the "
        "camera's black level some codes off",
        reference.codes.size() > 1 ? codes.name + ": " : "", *codes.left_out_dn));
    return;
  }
}

}  // namespace

void warn_of_scaled_codes(const std::vector<FlatObservation>& flats, const FlatReference& reference,
                          PhysicsCalibration& out) {
  ScaledCodes worst;
  for (std::size_t c = 0; c < reference.codes.size(); ++c) {
    const ScaledCodes own = scaled_codes(flats, c, reference.codes[c], out.temporal_sd_dark_dn[c]);
    if (own.channel && (!worst.channel || own.of_dark > worst.of_dark)) worst = own;
  }
  if (!worst.channel) {
    warn_of_left_out_code(reference, out);
    return;
  }
  out.warnings.push_back(fmt::format(
      "{} codes lie {:.4g} DN apart, but are no multiples of it: values were multiplied after the "
      "conversion (few bits stretched to 16, a digital gain, white balance), or the converter "
      "leaves codes out. Such steps are {} % of the dark variance, and σ_TL and λ may be off by "
      "several times that; record values that are not scaled, or undo it",
      reference.codes.size() > 1 ? worst.channel->name + ": its" : "its", worst.spacing_dn,
      percent_text(std::min(worst.of_dark, 1.0))));
}

bool warn_of_flats(const std::vector<FlatObservation>& flats, const FlatReference& reference,
                   PhysicsCalibration& out) {
  const std::size_t before = out.warnings.size();
  warn_of_flats_below_dark(flats, reference, out);
  warn_of_mixed_light(flats, reference, out);
  warn_of_unlike_frames(flats, out);
  warn_of_low_white(flats, reference, out);
  warn_of_high_white(flats, reference, out);
  warn_of_companding(flats, out);
  warn_of_scaled_codes(flats, reference, out);
  warn_of_changing_light(flats, reference, out);
  return out.warnings.size() > before;
}

// y = (1 - ρ) x + ρ y' of the frame before has x's mean, (1 - ρ)/(1 + ρ) of its variance and
// correlates by ρ, ρ², ...: the sample variance of M such frames misses 2 ρ / M more, to first
// order.
void warn_of_image_lag(const std::vector<FlatObservation>& flats, const SuccessiveFrames& dark,
                       PhysicsCalibration& out) {
  constexpr double kLeast = 0.005, kErrors = 5.0, kOfLevels = 0.5;
  SuccessiveProducts all;
  std::vector<double> of_level, per_frame;
  for (const FlatObservation& flat : flats) {
    if (!(flat.successive.pixels > 0)) continue;
    all.merge(flat.successive);
    of_level.push_back(flat.successive.correlation());
    per_frame.push_back(1.0 / static_cast<double>(flat.sources.size()));
  }
  const double lag = all.correlation(), error = all.standard_error();
  if (mixes_frames(dark) || out.K.mean.empty() || !(lag > std::max(kLeast, kErrors * error)))
    return;
  if (!(median_of(of_level) > kOfLevels * lag)) return;  // one frame that is partly stale
  const double kept = (1.0 - lag) / (1.0 + lag) * (1.0 - 2.0 * lag * mean_of(per_frame));
  out.warnings.push_back(fmt::format(
      "a pixel's noise in a flat correlates by {:.3f} ± {:.1g} with that in the frame before: "
      "image lag, or the camera mixes frames. K is some {:.2g} % too small, and what is told in "
      "electrons too large; let the sensor reset between frames (pauses, single triggered frames), "
      "or turn "
      "off temporal noise reduction",
      lag, error, 100 * (1.0 - kept)));
}

}  // namespace malus
