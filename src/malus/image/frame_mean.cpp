#include "malus/image/frame_mean.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <string>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kPlace = 4;                  // pixels, at least
constexpr double kMostSaturated = 0.1;     // of the frames
constexpr double kChangedDeviations = 6;   // of what places of this light differ by
constexpr int kChangedBeside = 2;          // of the eight around: single pixels that blink are none
constexpr std::size_t kPlacesAlike = 256;  // of a light, at least

[[noreturn]] void refuse(const RawFrame& frame, const RawFrame& first, const std::string& what) {
  throw InputError(frame.source, fmt::format("{} than {} has", what, first.source),
                   "give frames of one scene that were taken alike");
}

void require_alike(const RawFrame& frame, const RawFrame& first, int rows, int cols) {
  if (frame.dn.rows() != rows || frame.dn.cols() != cols)
    refuse(frame, first,
           fmt::format("has {} x {} pixels, other ones", frame.dn.cols(), frame.dn.rows()));
  if (!(frame.layout == first.layout)) refuse(frame, first, "has another layout");
  if (frame.black_dn != first.black_dn || frame.black_known != first.black_known)
    refuse(frame, first, "has another black level");
  if (frame.white_known && first.white_known && frame.white_dn != first.white_dn)
    refuse(frame, first, "has another white level");
  if (frame.gain != first.gain) refuse(frame, first, "was taken at another gain");
  if (frame.exposure_s != first.exposure_s) refuse(frame, first, "has another exposure");
  if (frame.bits != first.bits) refuse(frame, first, "has pixels of another type");
}

// At least kPlace, in whole cells.
int place_size(int cell) { return (kPlace + cell - 1) / cell * cell; }

void add_places(View<const float> dn, int place_rows, int place_cols, Plane<double>& sums) {
  for (int r = 0; r < sums.rows() * place_rows; ++r)
    for (int c = 0; c < sums.cols() * place_cols; ++c)
      sums(r / place_rows, c / place_cols) += dn(r, c);
}

// Places in the order of their light, in runs of some that count as alike.
std::vector<std::vector<std::size_t>> places_alike(const std::vector<double>& light) {
  constexpr std::size_t kMostRuns = 32;
  std::vector<std::size_t> order(light.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::sort(order.begin(), order.end(),
            [&](std::size_t a, std::size_t b) { return light[a] < light[b]; });
  const std::size_t runs = std::clamp<std::size_t>(order.size() / kPlacesAlike, 1, kMostRuns);
  std::vector<std::vector<std::size_t>> alike(runs);
  for (std::size_t i = 0; i < order.size(); ++i) alike[i * runs / order.size()].push_back(order[i]);
  return alike;
}

// Which of the differences are far from those of places of the same light. What saturates hardly
// differs at all, so half of the usual difference is the least that counts.
std::vector<bool> far_off(const std::vector<double>& difference, const std::vector<double>& light) {
  const double least = 0.5 * robust_deviation_of(difference);
  std::vector<bool> far(difference.size());
  for (const std::vector<std::size_t>& run : places_alike(light)) {
    std::vector<double> own;
    for (const std::size_t i : run) own.push_back(difference[i]);
    const double middle = median_of(own),
                 limit = kChangedDeviations * std::max(robust_deviation_of(own), least);
    for (const std::size_t i : run) far[i] = std::abs(difference[i] - middle) > limit;
  }
  return far;
}

double share_with_company(const std::vector<bool>& far, int rows, int cols) {
  const auto is_far = [&](int r, int c) {
    return r >= 0 && c >= 0 && r < rows && c < cols &&
           far[static_cast<std::size_t>(r) * static_cast<std::size_t>(cols) +
               static_cast<std::size_t>(c)];
  };
  std::int64_t count = 0;
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      if (!is_far(r, c)) continue;
      int beside = -1;  // itself
      for (int i = -1; i <= 1; ++i)
        for (int k = -1; k <= 1; ++k) beside += is_far(r + i, c + k);
      count += beside >= kChangedBeside;
    }
  return static_cast<double>(count) / std::max(static_cast<double>(far.size()), 1.0);
}

}  // namespace

void FrameMean::add(View<const float> frame_dn) {
  if (count_ == 0) sum_ = Plane<double>(frame_dn.rows(), frame_dn.cols());
  MALUS_REQUIRE(frame_dn.rows() == sum_.rows() && frame_dn.cols() == sum_.cols());
  for (int r = 0; r < sum_.rows(); ++r) {
    double* sum = sum_.row(r);
    for (int c = 0; c < sum_.cols(); ++c) sum[c] += static_cast<double>(frame_dn(r, c));
  }
  ++count_;
}

Image FrameMean::mean() const {
  MALUS_REQUIRE(count_ > 0);
  Image mean(sum_.rows(), sum_.cols());
  std::transform(sum_.values().begin(), sum_.values().end(), mean.values().begin(),
                 [this](double sum) { return static_cast<float>(sum / count_); });
  return mean;
}

SceneMean::SceneMean(int of_frames) : of_frames_(of_frames) {
  MALUS_REQUIRE(of_frames >= 2 && of_frames <= kMostAveraged);
}

void SceneMean::begin(const RawFrame& frame) {
  place_rows_ = place_size(frame.layout.rows());
  place_cols_ = place_size(frame.layout.cols());
  early_ = late_ = Plane<double>(frame.dn.rows() / place_rows_, frame.dn.cols() / place_cols_);
  first_ = frame;
  first_.dn = Image();
}

void SceneMean::add(const RawFrame& frame) {
  MALUS_REQUIRE(pixels_.count() < of_frames_);
  require_single(frame);
  const bool early = pixels_.count() < of_frames_ / 2;
  if (pixels_.count() == 0)
    begin(frame);
  else
    require_alike(frame, first_, pixels_.rows(), pixels_.cols());
  seen_.refuse_copy(frame, pixel_fingerprint(frame.dn));
  pixels_.add(frame.dn);
  const auto& values = frame.dn.values();
  const auto white_dn = static_cast<float>(frame.white_dn);
  const bool no_white = white_is_guessed(frame);
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (no_white || !(values[i] >= white_dn)) continue;
    if (saturated_.empty()) saturated_.resize(values.size());
    ++saturated_[i];
  }
  add_places(frame.dn.view(), place_rows_, place_cols_, early ? early_ : late_);
}

RawFrame SceneMean::take() {
  MALUS_REQUIRE(pixels_.count() == of_frames_);
  RawFrame mean = std::move(first_);
  mean.dn = pixels_.mean();
  for (std::size_t i = 0; i < saturated_.size(); ++i)
    if (saturated_[i] > kMostSaturated * of_frames_) {
      mean.dn.values()[i] = static_cast<float>(mean.white_dn);
      mean.white_known = true;  // of codes of so many bits; the mean's values have none
    }
  if (mean.bits == 0) mean.black_known = true;
  mean.bits = 0;
  mean.mean_of = of_frames_;
  return mean;
}

double SceneMean::changed_share() const {
  const int late_frames = pixels_.count() - of_frames_ / 2;
  if (late_frames < 1 || early_.empty()) return 0;
  double place_black = 0;  // every place is of whole cells
  for (int r = 0; r < place_rows_; ++r)
    for (int c = 0; c < place_cols_; ++c) place_black += first_.black_at(r, c);
  double early_sum = 0, late_sum = 0;
  std::vector<double> early, late;
  for (std::size_t i = 0; i < early_.size(); ++i) {
    const double a = early_.values()[i] / (of_frames_ / 2) - place_black,
                 b = late_.values()[i] / late_frames - place_black;
    const bool is_number = std::isfinite(a) && std::isfinite(b);
    early.push_back(is_number ? a : 0);
    late.push_back(is_number ? b : 0);
    early_sum += early.back();
    late_sum += late.back();
  }
  // Light that changed everywhere alike.
  const double ratio = late_sum > 0 ? early_sum / late_sum : 1;
  std::vector<double> difference, light;
  for (std::size_t i = 0; i < early.size(); ++i) {
    difference.push_back(early[i] - ratio * late[i]);
    light.push_back(early[i] + ratio * late[i]);
  }
  return share_with_company(far_off(difference, light), early_.rows(), early_.cols());
}

void require_single(const RawFrame& frame) {
  if (frame.mean_of > 1)
    throw InputError(
        frame.source,
        fmt::format("is a mean of {} frames; here the noise of one counts", frame.mean_of),
        "give the frames themselves");
}

}  // namespace malus
