#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/base/wording.h"
#include "malus/denoise/column_noise.h"
#include "malus/denoise/internal/channel_levels.h"
#include "malus/denoise/internal/impulses.h"
#include "malus/denoise/internal/noiseless_areas.h"
#include "malus/denoise/internal/pattern_removal.h"
#include "malus/denoise/prepared_frame.h"
#include "malus/denoise/row_noise.h"
#include "malus/image/black_levels.h"
#include "malus/noise/same_sensor.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

struct Filling {
  float dn = std::numeric_limits<float>::quiet_NaN();
  float variance_dn2 = std::numeric_limits<float>::quiet_NaN();
};

// Mean of the finite pixels of the same channel in growing rings; NaN when none is nearby. Its
// variance is that of the means of opposite pixels, each an estimate of its own in which slopes
// cancel, but for their noise; where there are no two such pairs, that of the pixels.
Filling filled(View<const float> dn, const NoiseProfile& profile, int row, int col) {
  const SensorLayout& layout = profile.layout;
  constexpr int kRings = 8;
  const auto finite = [&](int i, int k) {
    const int r = row + i * layout.rows(), c = col + k * layout.cols();
    return r >= 0 && c >= 0 && r < dn.rows() && c < dn.cols() && std::isfinite(dn(r, c));
  };
  const auto at = [&](int i, int k) {
    return double{dn(row + i * layout.rows(), col + k * layout.cols())};
  };
  for (int ring = 1; ring <= kRings; ++ring) {
    Moments pixels, pairs;
    double sum = 0;
    int count = 0;
    for (int i = -ring; i <= ring; ++i)
      for (int k = -ring; k <= ring; ++k) {
        if (std::max(std::abs(i), std::abs(k)) != ring || !finite(i, k)) continue;
        sum += at(i, k);
        ++count;
        pixels.add(at(i, k));
        if ((i < 0 || (i == 0 && k < 0)) && finite(-i, -k)) pairs.add((at(i, k) + at(-i, -k)) / 2);
      }
    if (count == 0) continue;
    const bool in_pairs = pairs.count() > 1;
    const double mean = sum / count, spread = in_pairs ? pairs.variance() : pixels.variance();
    const auto k = static_cast<std::size_t>(layout.channel_at(row, col));
    const double noise = profile.channels[k].variance(mean) / (in_pairs ? 2 : 1);
    return {static_cast<float>(mean), static_cast<float>(std::max(spread - noise, 0.0))};
  }
  return {};
}

// Pixels of large holes take the value of a neighbour, forth and back: those in raster order reach
// every place from any pixel of their channel.
template <class Places>
void extend_into_holes(Image& dn, const SensorLayout& layout, const Places& places) {
  const auto take = [&](int row, int col, int sign) {
    if (std::isfinite(dn(row, col))) return;
    const int r = row + sign * layout.rows(), c = col + sign * layout.cols();
    if (c >= 0 && c < dn.cols() && std::isfinite(dn(row, c)))
      dn(row, col) = dn(row, c);
    else if (r >= 0 && r < dn.rows() && std::isfinite(dn(r, col)))
      dn(row, col) = dn(r, col);
  };
  for (const auto& p : places) take(p.row, p.col, -1);
  for (auto p = places.rbegin(); p != places.rend(); ++p) take(p->row, p->col, 1);
}

// Replacements are computed from the input's own pixels before any is written.
template <class Places>
std::vector<FilledPixel> fill(Image& dn, const NoiseProfile& profile, const Places& places) {
  std::vector<Filling> replacement;
  for (const auto& p : places) replacement.push_back(filled(dn, profile, p.row, p.col));
  std::vector<FilledPixel> pixels;
  for (std::size_t i = 0; i < places.size(); ++i) {
    dn(places[i].row, places[i].col) = replacement[i].dn;
    pixels.push_back({places[i].row, places[i].col, replacement[i].variance_dn2});
  }
  extend_into_holes(dn, profile.layout, places);
  return pixels;
}

// All of them become NaN, which no measurement takes for a pixel. They come back above black: no
// bias is in them.
std::vector<NonfinitePixel> take_nonfinite(RawFrame& frame) {
  const LightRange light = light_range(frame);
  std::vector<NonfinitePixel> list;
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      float& pixel = frame.dn(r, c);
      if (light.holds(pixel)) continue;
      list.push_back({r, c, pixel - static_cast<float>(frame.black_at(r, c))});
      pixel = std::numeric_limits<float>::quiet_NaN();
    }
  return list;
}

// What is done to the pixels that show noise: others are none to it, and come back as they were.
template <class Step>
void without_noiseless(PreparedFrame& frame, const Step& step) {
  std::vector<float> kept_dn;
  for (std::size_t p = 0; p < frame.is_noiseless.size(); ++p)
    if (frame.is_noiseless[p])
      kept_dn.push_back(
          std::exchange(frame.dn.values()[p], std::numeric_limits<float>::quiet_NaN()));
  step();
  auto kept = kept_dn.begin();
  for (std::size_t p = 0; p < frame.is_noiseless.size(); ++p)
    if (frame.is_noiseless[p]) frame.dn.values()[p] = *kept++;
}

void forget(Image& dn, const std::vector<DefectList::Place>& places) {
  for (const DefectList::Place& p : places)
    dn(p.row, p.col) = std::numeric_limits<float>::quiet_NaN();
}

// Those that hold a number: others come back as they are, whatever the list says of them.
std::vector<DefectList::Place> defects_of(View<const float> dn, const DefectList& defects) {
  std::vector<DefectList::Place> places;
  if (defects.rows != dn.rows() || defects.cols != dn.cols()) return places;
  for (const DefectList::Place& p : defects.places)
    if (std::isfinite(dn(p.row, p.col))) places.push_back(p);
  return places;
}

// Places that were forgotten. A defect that has nothing but pixels without light around it becomes
// one: what it holds is no light, and nothing tells a better one.
void fill_defects(PreparedFrame& frame, const NoiseProfile& profile,
                  const std::vector<DefectList::Place>& places) {
  const Image& dn = frame.dn;
  frame.filled = fill(frame.dn, profile, places);
  for (const FilledPixel& p : frame.filled)
    if (!std::isfinite(dn(p.row, p.col)))
      frame.nonfinite.push_back({p.row, p.col, dn(p.row, p.col)});
  std::sort(frame.nonfinite.begin(), frame.nonfinite.end(), precedes);
  std::erase_if(frame.filled,
                [&](const FilledPixel& p) { return !std::isfinite(dn(p.row, p.col)); });
}

// What fills them is no measurement; 0 in channels without a number.
void fill_nonfinite(PreparedFrame& frame, const NoiseProfile& profile) {
  fill(frame.dn, profile, frame.nonfinite);
  for (const NonfinitePixel& p : frame.nonfinite)
    if (!std::isfinite(frame.dn(p.row, p.col))) frame.dn(p.row, p.col) = 0.0f;
}

void take_out_pattern(PreparedFrame& frame, const NoiseProfile& profile,
                      const std::vector<float>& saturated_dn, Denoised& report) {
  if (!profile.pattern) return;
  for (const Image* map : {&profile.pattern->dark_dn, &profile.pattern->response})
    if (!map->empty() && (map->rows() != frame.dn.rows() || map->cols() != frame.dn.cols())) return;
  const MeasuredPattern shares = measure_pattern(frame.dn, frame.layout, profile, saturated_dn);
  remove_pattern(frame.dn, frame.layout, *profile.pattern, shares, frame.saturated);
  report.dark_pattern_share = shares.dark.taken();
  report.response_pattern_share = shares.response.taken();
}

// Variance of what is left of offsets, in units of their deviation's square.
std::vector<double> variances_of(const RowNoise& lines) {
  std::vector<double> variance;
  for (const double deviation : lines.deviation) variance.push_back(deviation * deviation);
  return variance;
}

// Root mean square of offsets that were taken out, for the channels' mean deviation.
double removed_dn(const RowNoise& lines, const NoiseProfile& profile,
                  double ChannelProfile::*sigma_dn) {
  double sum = 0, sigma = 0;
  for (const double offset : lines.offset) sum += offset * offset;
  for (const ChannelProfile& channel : profile.channels) sigma += channel.*sigma_dn;
  return std::sqrt(sum / static_cast<double>(lines.offset.size())) * sigma /
         static_cast<double>(profile.channels.size());
}

void take_out_lines(PreparedFrame& frame, const NoiseProfile& profile,
                    const std::vector<float>& saturated_dn, PreparationSteps steps,
                    Denoised& report) {
  const auto group = static_cast<std::size_t>(profile.row_group);
  frame.row_variance.assign((static_cast<std::size_t>(frame.dn.rows()) + group - 1) / group, 1.0);
  frame.column_variance.assign(static_cast<std::size_t>(frame.dn.cols()), 1.0);
  if (steps.remove_rows) {
    const RowNoise rows = estimate_row_noise(frame.dn, profile, saturated_dn);
    remove_row_noise(frame.dn, profile, rows, frame.saturated);
    frame.row_variance = variances_of(rows);
    report.row_noise_removed_dn = removed_dn(rows, profile, &ChannelProfile::sigma_row_dn);
  }
  if (steps.remove_columns && profile.has_column_noise()) {
    const RowNoise columns = estimate_column_noise(frame.dn, profile, saturated_dn);
    remove_column_noise(frame.dn, profile, columns, frame.saturated);
    frame.column_variance = variances_of(columns);
    report.column_noise_removed_dn = removed_dn(columns, profile, &ChannelProfile::sigma_column_dn);
  }
}

// Per channel.
struct ChannelSums {
  std::vector<double> sum, count;
  explicit ChannelSums(const SensorLayout& layout)
      : sum(static_cast<std::size_t>(layout.channels())), count(sum) {}
  void add(int channel, double value, double sign) {
    sum[static_cast<std::size_t>(channel)] += sign * value;
    count[static_cast<std::size_t>(channel)] += sign;
  }
  ChannelSums with(const ChannelSums& other) const {
    ChannelSums both = *this;
    for (std::size_t k = 0; k < sum.size(); ++k) {
      both.sum[k] += other.sum[k];
      both.count[k] += other.count[k];
    }
    return both;
  }
};

// Without what stands in the place of pixels that are not numbers.
std::vector<double> channel_means(View<const float> dn, const SensorLayout& layout,
                                  const std::vector<NonfinitePixel>& nonfinite) {
  ChannelSums all = parallel_reduce(
      0, dn.rows(), kRowsPerTask, ChannelSums(layout),
      [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
        ChannelSums rows(layout);
        for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
          for (int c = 0; c < dn.cols(); ++c) rows.add(layout.channel_at(r, c), dn(r, c), 1);
        return rows;
      },
      [](const ChannelSums& a, const ChannelSums& b) { return a.with(b); });
  for (const NonfinitePixel& p : nonfinite)
    all.add(layout.channel_at(p.row, p.col), dn(p.row, p.col), -1);
  std::vector<double> means;
  for (std::size_t k = 0; k < all.sum.size(); ++k)
    means.push_back(all.count[k] > 0 ? all.sum[k] / all.count[k] : 0.0);
  return means;
}

// Takes the channels' zero off; returns how many pixels are saturated then.
std::int64_t subtract_zero(Image& dn, const SensorLayout& layout, const std::vector<float>& zero_dn,
                           const std::vector<float>& saturated_dn) {
  return parallel_reduce(
      0, dn.rows(), kRowsPerTask, std::int64_t{0},
      [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
        std::int64_t saturated = 0;
        for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
          for (int c = 0; c < dn.cols(); ++c) {
            const auto k = static_cast<std::size_t>(layout.channel_at(r, c));
            dn(r, c) -= zero_dn[k];
            if (dn(r, c) >= saturated_dn[k]) ++saturated;
          }
        return saturated;
      },
      std::plus<>());
}

// Tables reach up to white: it has to be above black, and not so far that they never end.
void require_range(const RawFrame& frame) {
  const double range_dn = white_above_black(frame.white_dn, frame.black_dn);
  const bool guessed = white_is_guessed(frame);
  if (!(range_dn > 0))
    throw InputError(frame.source,
                     guessed ? "no pixel is above black, and white is not known"
                             : fmt::format("white {:g} DN is not above black", frame.white_dn),
                     "give white (" + setting("white") + ")");
  if (!(range_dn <= kMostCountedDn))
    throw InputError(
        frame.source,
        guessed
            ? fmt::format("white is not known, and the largest pixel is {:g} DN", frame.white_dn)
            : fmt::format("white {:g} DN is above all that cameras count", frame.white_dn),
        "check " + setting("white") + " and the file's scale");
}

}  // namespace

void require_pixels(const RawFrame& frame) {
  if (frame.dn.empty())
    throw InputError(frame.source, "has no pixels", "give a frame with at least one");
}

void check_frame(const RawFrame& frame, const NoiseProfile& profile) {
  require_pixels(frame);
  require_layout_of_model(frame, profile.layout);
  require_levels(frame);
  require_range(frame);
}

PreparedFrame prepare_frame(RawFrame frame, const NoiseProfile& profile, PreparationSteps steps,
                            Denoised& report) {
  PreparedFrame prepared;
  prepared.layout = frame.layout;
  prepared.source = frame.source;
  prepared.range_dn = white_above_black(frame.white_dn, frame.black_dn);
  prepared.nonfinite = take_nonfinite(frame);
  // No pixels until pattern and lines are out: what fills them has no offset of their own row.
  const std::vector<DefectList::Place> defects =
      steps.fill_defects ? defects_of(frame.dn, profile.defects) : std::vector<DefectList::Place>();
  forget(frame.dn, defects);
  const internal::ChannelLevels levels = internal::channel_levels(frame, profile);
  prepared.highest_dn = levels.highest_dn;
  const std::vector<float>& saturated_dn = prepared.saturated_dn = levels.saturated_dn;
  report.saturated_pixels = subtract_zero(frame.dn, frame.layout, levels.zero_dn, saturated_dn);
  prepared.dn = std::move(frame.dn);
  prepared.saturated = SaturatedPixels(prepared.dn, prepared.layout, saturated_dn);
  prepared.is_noiseless = noiseless_areas(prepared.dn, prepared.layout, saturated_dn);
  without_noiseless(prepared, [&] {
    if (steps.remove_pattern) take_out_pattern(prepared, profile, saturated_dn, report);
    take_out_lines(prepared, profile, saturated_dn, steps, report);
  });
  fill_defects(prepared, profile, defects);
  fill_nonfinite(prepared, profile);
  report.nonfinite_pixels = std::ssize(prepared.nonfinite);
  report.defect_pixels = std::ssize(prepared.filled);
  if (steps.fill_impulses) {
    const std::vector<DefectList::Place> impulses = find_impulses(prepared, profile);
    forget(prepared.dn, impulses);
    const std::vector<FilledPixel> pixels = fill(prepared.dn, profile, impulses);
    report.impulse_pixels = std::ssize(pixels);
    prepared.filled.insert(prepared.filled.end(), pixels.begin(), pixels.end());
  }
  prepared.mean_dn = channel_means(prepared.dn, prepared.layout, prepared.nonfinite);
  for (std::size_t k = 0; k < profile.channels.size(); ++k)
    report.sigma_used_dn.push_back(std::sqrt(profile.channels[k].variance(prepared.mean_dn[k])));
  if (steps.compare_noise) report.noise = check_noise(prepared, profile);
  return prepared;
}

void complete_result(const PreparedFrame& frame, Denoised& result) {
  result.mean_dn = frame.mean_dn;
  result.mean_shift_dn = channel_means(result.dn_above_black, frame.layout, frame.nonfinite);
  for (std::size_t k = 0; k < frame.mean_dn.size(); ++k)
    result.mean_shift_dn[k] -= frame.mean_dn[k];
  for (const NonfinitePixel& p : frame.nonfinite) {
    result.dn_above_black(p.row, p.col) = p.value;
    if (result.variance_dn2)
      (*result.variance_dn2)(p.row, p.col) = std::numeric_limits<float>::quiet_NaN();
  }
}

std::vector<Stabilizer> make_stabilizers(const NoiseProfile& profile, double highest_dn,
                                         double strength) {
  std::vector<Stabilizer> stabilizers;
  for (const ChannelProfile& channel : profile.channels)
    stabilizers.emplace_back(channel.variance.scaled(strength * strength), highest_dn,
                             channel.distribution());
  return stabilizers;
}

}  // namespace malus
