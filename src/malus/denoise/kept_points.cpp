#include "malus/denoise/internal/kept_points.h"

#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/denoise/internal/noise_tails.h"
#include "malus/denoise/internal/sampled_pixels.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>

namespace malus {
namespace {

// Deviations: from the first on a pixel is doubtful, from kLeastFar on it may be a point, and what
// stands out by kLeastHigh or more is more than noise that was told too small by half.
constexpr double kBounds[] = {3, 3.5, 4, 4.5, 5, 6, 8, 12, 20};
constexpr std::size_t kLeastFar = 4, kLeastHigh = 7;
constexpr double kExplainedShare = 0.1;  // of the pixels beyond a bound, by the noise
constexpr double kByChance = 1e-3;       // that it makes as many
constexpr double kTakenFrom = 2;         // median of squared residuals; the noise's is 0.45
constexpr double kSurePart = 0.3;
constexpr std::size_t kSpreadSamples = 65536;
constexpr int kRowsAtOnce = 32;

// What the result leaves of a frame.
class Residual {
 public:
  Residual(const PreparedFrame& frame, const std::vector<Stabilizer>& stabilizers,
           const Image& result_dn)
      : frame_(frame), stabilizers_(stabilizers), result_dn_(result_dn) {
    filled_.assign(frame.dn.size(), false);
    for (const FilledPixel& p : frame.filled) filled_[index(p.row, p.col)] = true;
    for (const NonfinitePixel& p : frame.nonfinite) filled_[index(p.row, p.col)] = true;
    std::vector<std::vector<double>> sizes(stabilizers.size());
    scale_.assign(stabilizers.size(), 1.0);
    internal::for_each_sampled(frame.dn, kSpreadSamples, [&](int row, int col) {
      if (is_measured(row, col)) sizes[channel(row, col)].push_back((*this)(row, col));
    });
    for (std::size_t k = 0; k < sizes.size(); ++k)
      if (!sizes[k].empty()) scale_[k] = std::max(median_of(sizes[k]) / kMedianOfNormal, 1.0);
  }
  /// How far the frame lies from the result, in deviations of the noise, or of the channel's
  /// residuals where they spread further. 0 of pixels that were not measured.
  double operator()(int row, int col) const {
    if (!is_measured(row, col)) return 0;
    return std::abs(above(row, col, row, col)) / scale_[channel(row, col)];
  }
  /// How far the frame's pixel lies above or below all eight of the result that are its channel's
  /// nearest. 0 where that is less than `enough`, and of pixels not measured.
  double beyond_surroundings(int row, int col, double enough) const {
    if (!is_measured(row, col)) return 0;
    const double scale = scale_[channel(row, col)];
    double peak = std::numeric_limits<double>::infinity(), pit = peak;
    for (int i = -1; i <= 1; ++i)
      for (int k = -1; k <= 1; ++k) {
        const int r = row + i * frame_.layout.rows(), c = col + k * frame_.layout.cols();
        if ((!i && !k) || r < 0 || c < 0 || r >= frame_.dn.rows() || c >= frame_.dn.cols())
          continue;
        const double height = above(row, col, r, c) / scale;
        peak = std::min(peak, height);
        pit = std::min(pit, -height);
        if (peak < enough && pit < enough) return 0;
      }
    return std::isfinite(peak) ? std::max(peak, pit) : 0;
  }

 private:
  // Saturated ones were not, nor are those that were filled from others.
  bool is_measured(int row, int col) const {
    return !frame_.saturated(row, col) && !filled_[index(row, col)];
  }
  std::size_t index(int row, int col) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(frame_.dn.cols()) +
           static_cast<std::size_t>(col);
  }
  // The frame's pixel above the light of the result at a pixel of its channel, in deviations of the
  // noise. Stabilised, which is what shot noise's long upper tail needs; but its lower tail is a
  // short one, and down there deviations of the light's own noise count: in units of the darker
  // pixel's, 4 of them at 18 electrons would be 6.
  double above(int row, int col, int light_row, int light_col) const {
    const Stabilizer& stabilizer = stabilizers_[channel(row, col)];
    const double pixel_dn = frame_.dn(row, col), light_dn = result_dn_(light_row, light_col);
    const double stabilised = stabilizer.forward(pixel_dn) - stabilizer.forward(light_dn);
    if (stabilised > -kBounds[0]) return stabilised;
    const double deviation_dn = stabilizer.inverse_slope(stabilizer.mean_of(light_dn));
    return std::max(stabilised, (pixel_dn - light_dn) / deviation_dn);
  }
  std::size_t channel(int row, int col) const {
    return static_cast<std::size_t>(frame_.layout.channel_at(row, col));
  }
  const PreparedFrame& frame_;
  const std::vector<Stabilizer>& stabilizers_;
  const Image& result_dn_;
  std::vector<double> scale_;
  std::vector<bool> filled_;
};

// One that is doubtful or stands out of its surroundings.
struct Candidate {
  int row, col;
  double residual, standing_out;  ///< deviations
  bool doubtful() const { return residual > kBounds[0]; }
  /// A filter that keeps some of a point's light leaves less of it in the residual.
  double far() const { return doubtful() ? std::max(residual, standing_out) : 0; }
};

std::vector<Candidate> candidates(const PreparedFrame& frame, const Residual& residual) {
  const int bands = (frame.dn.rows() + kRowsAtOnce - 1) / kRowsAtOnce;
  std::vector<std::vector<Candidate>> of_band(static_cast<std::size_t>(bands));
  parallel_for(0, bands, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int b = static_cast<int>(begin); b < static_cast<int>(end); ++b)
      for (int r = b * kRowsAtOnce; r < std::min((b + 1) * kRowsAtOnce, frame.dn.rows()); ++r)
        for (int c = 0; c < frame.dn.cols(); ++c) {
          const Candidate pixel{r, c, residual(r, c),
                                residual.beyond_surroundings(r, c, kBounds[kLeastFar])};
          if (pixel.doubtful() || pixel.standing_out > 0)
            of_band[static_cast<std::size_t>(b)].push_back(pixel);
        }
  });
  std::vector<Candidate> all;
  for (const auto& band : of_band) all.insert(all.end(), band.begin(), band.end());
  return all;
}

// Chernoff's bound on a Poisson count: how likely the noise alone has thrown as many that far.
double chance_of(double found, double expected) {
  return std::exp(found - expected + found * std::log(std::max(expected, 1e-300) / found));
}

double far_out(const Candidate& p) { return p.far(); }
double standing_out(const Candidate& p) { return p.standing_out; }
using Measure = double (*)(const Candidate&);

double count_beyond(const std::vector<Candidate>& pixels, Measure measure, double bound) {
  return static_cast<double>(
      std::ranges::count_if(pixels, [&](const Candidate& p) { return measure(p) > bound; }));
}

// The least bound, from kBounds[first] on, beyond which a measure of the pixels lies in more of
// them than the noise explains.
double unexplained_beyond(const std::vector<Candidate>& pixels, const std::vector<double>& expected,
                          std::size_t first, Measure measure) {
  for (std::size_t t = first; t < expected.size(); ++t) {
    const double found = count_beyond(pixels, measure, kBounds[t]);
    if (found > 0 && expected[t] <= kExplainedShare * found &&
        chance_of(found, expected[t]) < kByChance)
      return kBounds[t];
  }
  return std::numeric_limits<double>::infinity();
}

// Whether the filter took light from most of what stands out further.
bool lost_light(const std::vector<Candidate>& pixels, double bound) {
  std::vector<double> squares;
  for (const Candidate& p : pixels)
    if (p.standing_out > bound) squares.push_back(p.residual * p.residual);
  return !squares.empty() && median_of(squares) > kTakenFrom;
}

// Those far out. Besides all that stands out as far, where most of it lost light to the filter, and
// either a good part of it is far out or it stands out further than any error of the noise's
// deviation could make it.
std::vector<Candidate> points_among(const std::vector<Candidate>& pixels,
                                    const std::vector<double>& expected) {
  const double far = unexplained_beyond(pixels, expected, kLeastFar, far_out),
               high = unexplained_beyond(pixels, expected, kLeastHigh, standing_out);
  double all_beyond = std::numeric_limits<double>::infinity();
  if (lost_light(pixels, high)) all_beyond = high;
  if (count_beyond(pixels, far_out, far) > kSurePart * count_beyond(pixels, standing_out, far) &&
      lost_light(pixels, far))
    all_beyond = far;
  std::vector<Candidate> points;
  std::ranges::copy_if(pixels, std::back_inserter(points), [&](const Candidate& p) {
    return p.far() > far || p.standing_out > all_beyond;
  });
  return points;
}

std::size_t bracket_of(double residual) {
  return static_cast<std::size_t>(std::ranges::upper_bound(kBounds, residual) - kBounds) - 1;
}

// Of pixels whose residual has a size, where there are more than the noise makes (by more than
// chance does), some are points, and nobody knows which: the share that is not explained times the
// residual's square is what they add to the expected error.
void state_doubt(const PreparedFrame& frame, const std::vector<Candidate>& pixels,
                 std::vector<double> expected, Denoised& report) {
  std::vector<double> found(expected.size());
  for (const Candidate& p : pixels)
    if (p.doubtful()) found[bracket_of(p.residual)] += 1;
  for (std::size_t b = 0; b + 1 < expected.size(); ++b) expected[b] -= expected[b + 1];
  for (const Candidate& p : pixels) {
    if (!p.doubtful()) continue;
    const std::size_t b = bracket_of(p.residual);
    const double explained = expected[b] + 2 * std::sqrt(expected[b]);
    const double unexplained = std::max(1 - explained / found[b], 0.0);
    const double off_dn =
        double{frame.dn(p.row, p.col)} - double{report.dn_above_black(p.row, p.col)};
    (*report.variance_dn2)(p.row, p.col) += static_cast<float>(unexplained * off_dn * off_dn);
  }
}

void keep(const PreparedFrame& frame, const NoiseProfile& profile, int row, int col,
          Denoised& report) {
  const float dn = frame.dn(row, col);
  const auto channel = static_cast<std::size_t>(frame.layout.channel_at(row, col));
  report.dn_above_black(row, col) = dn;
  if (report.variance_dn2)
    (*report.variance_dn2)(row, col) = static_cast<float>(profile.channels[channel].variance(dn));
  ++report.kept_pixels;
}

}  // namespace

void keep_points(const PreparedFrame& frame, const NoiseProfile& profile,
                 const std::vector<Stabilizer>& stabilizers, Denoised& report) {
  report.kept_pixels = 0;
  const Residual residual(frame, stabilizers, report.dn_above_black);
  const std::vector<Candidate> pixels = candidates(frame, residual);
  const std::vector<double> expected = internal::expected_beyond(frame, profile, kBounds);
  if (report.variance_dn2) state_doubt(frame, pixels, expected, report);
  std::vector<Candidate> open = points_among(pixels, expected);
  for (const Candidate& p : open) keep(frame, profile, p.row, p.col, report);
  while (!open.empty()) {
    const Candidate p = open.back();
    open.pop_back();
    for (int r = std::max(p.row - 1, 0); r < std::min(p.row + 2, frame.dn.rows()); ++r)
      for (int c = std::max(p.col - 1, 0); c < std::min(p.col + 2, frame.dn.cols()); ++c)
        if (residual(r, c) > kBounds[0]) {  // not of those kept: it is 0
          keep(frame, profile, r, c, report);
          open.push_back({r, c, 0, 0});
        }
  }
}

}  // namespace malus
