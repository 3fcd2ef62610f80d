#include "malus/denoise/internal/row_stripes.h"

#include "malus/base/chi_square.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <complex>
#include <numbers>

namespace malus {
namespace {

// Long windows tell faint stripes of much of the frame, short ones those of a part of it.
constexpr int kWindows[] = {256, 64};
constexpr std::size_t kLeastWindowGroups = 32;
// Normal deviates that the power of a range of frequencies exceeds by chance: of white offsets that
// changes one frame of 60 (200 frames of 512 groups), by a thousandth of their variance.
constexpr double kSurprise = 4.5;
// The mean power of a wider range, in units of the camera's: rows that drift slowly (row_drift.h)
// come to twice a white sequence's.
constexpr double kLeastPower = 3.0;
// Neighbouring frequencies of a sine window share so much that this many are worth one.
constexpr double kSharedByNeighbours = 1.5;
// Of the power of most frequencies: rows half as strong again as the model's are a camera's, and
// the median of 32 powers is known to a quarter.
constexpr double kMostPower = 2.25 * 2;

using Spectrum = std::vector<std::complex<double>>;

class SineWindow {
 public:
  explicit SineWindow(int length) : length_(length) {
    for (int i = 0; i < length; ++i) {
      turn_.push_back(std::polar(1.0, angle(i)));
      weight_.push_back(std::sin(std::numbers::pi * (i + 0.5) / length));
    }
  }
  int length() const { return length_; }
  int frequencies() const { return length_ / 2 + 1; }
  double weight(int i) const { return weight_[static_cast<std::size_t>(i)]; }

  /// Of a frequency, per value.
  double angle(int f) const { return 2 * std::numbers::pi * f / length_; }

  /// Of the values from `first` on; those outside are 0.
  Spectrum spectrum(const std::vector<double>& values, int first) const {
    Spectrum out(static_cast<std::size_t>(frequencies()));
    for (int i = begin(first); i < end(values, first); ++i)
      for (int f = 0; f < frequencies(); ++f)
        out[static_cast<std::size_t>(f)] +=
            weight(i) * values[static_cast<std::size_t>(first + i)] * std::conj(turn(f, i));
    return out;
  }
  /// Adds the windowed sequence of this spectrum: windows half a length apart add up to one.
  void add(const Spectrum& spectrum, int first, std::vector<double>& values) const {
    for (int i = begin(first); i < end(values, first); ++i) {
      double sum = 0;
      for (int f = 0; f < frequencies(); ++f)
        sum += (f == 0 || 2 * f == length_ ? 1 : 2) *
               std::real(spectrum[static_cast<std::size_t>(f)] * turn(f, i));
      values[static_cast<std::size_t>(first + i)] += weight(i) * sum / length_;
    }
  }
  /// Squared weights inside the frame: the power of white values of deviation 1.
  double power(const std::vector<double>& values, int first) const {
    double sum = 0;
    for (int i = begin(first); i < end(values, first); ++i) sum += weight(i) * weight(i);
    return sum;
  }
  int begin(int first) const { return std::max(-first, 0); }
  int end(const std::vector<double>& values, int first) const {
    return std::min(length_, static_cast<int>(values.size()) - first);
  }

 private:
  std::complex<double> turn(int f, int i) const {
    return turn_[static_cast<std::size_t>(f) * static_cast<std::size_t>(i) %
                 static_cast<std::size_t>(length_)];
  }
  int length_;
  Spectrum turn_;
  std::vector<double> weight_;
};

// Mean power of this many frequencies that noise hardly exceeds.
double surprising_power(int count) {
  return chi_square_ratio(kSurprise, count == 1 ? 2.0 : 2.0 * count / kSharedByNeighbours);
}

// The share of every frequency that is the camera's. Of a sum of the camera's offsets, whose power
// is the usual one, and a picture's the former are expected to be their share of it (Wiener).
std::vector<double> cameras_share(const std::vector<double>& power) {
  std::vector<double> share(power.size(), 1.0);
  const double level = median_of({power.begin() + 1, power.end()}) / std::numbers::ln2;
  if (level > kMostPower) {
    for (std::size_t f = 0; f < power.size(); ++f) share[f] = std::min(1 / power[f], 1 / level);
    return share;
  }
  const double usual = std::max(level, 1.0);
  const int count = static_cast<int>(power.size());
  for (int width = 1; width < count; width *= 2) {
    const double most = usual * std::max(surprising_power(width), kLeastPower);
    double sum = 0;
    for (int f = 0; f < count; ++f) {
      sum += power[static_cast<std::size_t>(f)];
      if (f >= width) sum -= power[static_cast<std::size_t>(f - width)];
      if (f < width - 1 || sum < most * width) continue;
      for (int g = f - width + 1; g <= f; ++g) {
        double& s = share[static_cast<std::size_t>(g)];
        s = std::min(s, usual * width / sum);
      }
    }
  }
  return share;
}

void leave_stripes_of(const SineWindow& window, const RowDrift& drift, RowNoise& rows) {
  const int groups = static_cast<int>(rows.offset.size()), half = window.length() / 2;
  // What is left may be a camera's that drifts: all of it counts as missed.
  std::vector<double> kept(rows.offset.size()), missed(rows.offset.size());
  for (int first = -half; first < groups; first += half) {
    Spectrum spectrum = window.spectrum(rows.offset, first);
    const double white = window.power(rows.offset, first);
    std::vector<double> power, of_camera;
    for (std::size_t f = 0; f < spectrum.size(); ++f) {
      power.push_back(std::norm(spectrum[f]) / white);
      of_camera.push_back(power[f] / row_power(drift, window.angle(static_cast<int>(f))));
    }
    const std::vector<double> share = cameras_share(of_camera);
    double left = 0;
    for (std::size_t f = 0; f < share.size(); ++f) {
      spectrum[f] *= share[f];
      left += (1 - share[f]) * power[f] / static_cast<double>(share.size());
    }
    window.add(spectrum, first, kept);
    for (int i = window.begin(first); i < window.end(kept, first); ++i)
      missed[static_cast<std::size_t>(first + i)] += window.weight(i) * window.weight(i) * left;
  }
  for (std::size_t g = 0; g < missed.size(); ++g) {
    if (missed[g] == 0) continue;
    rows.offset[g] = kept[g];
    rows.deviation[g] = std::min(std::sqrt(std::pow(rows.deviation[g], 2) + missed[g]), 1.0);
  }
}

}  // namespace

void leave_stripes_in(RowNoise& rows, const RowDrift& drift) {
  if (rows.offset.size() < kLeastWindowGroups) return;
  for (const int length : kWindows)
    if (static_cast<int>(rows.offset.size()) >= length / 2)
      leave_stripes_of(SineWindow(length), drift, rows);
}

}  // namespace malus
