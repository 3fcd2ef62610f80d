#include "malus/evaluate/internal/compared_frames.h"

#include "malus/base/error.h"
#include "malus/image/frame_statistics.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

Image difference_of(const Image& a, const Image& b, float scale = 1) {
  Image difference(a.rows(), a.cols());
  for (std::size_t i = 0; i < difference.size(); ++i)
    difference.values()[i] = scale * (a.values()[i] - b.values()[i]);
  return difference;
}

// The same frames; one of another size than the first that was loaded is refused.
NoiseFrames of_one_size(NoiseFrames set, const char* name) {
  struct Size {
    int rows = 0, cols = 0;
  };
  set.load = [load = set.load, name, size = std::make_shared<Size>()](int k) {
    Image frame = load(k);
    if (size->rows == 0) *size = {frame.rows(), frame.cols()};
    if (frame.rows() != size->rows || frame.cols() != size->cols)
      throw InputError(name,
                       fmt::format("frame {} has {} x {} pixels, others {} x {}", k, frame.cols(),
                                   frame.rows(), size->cols, size->rows),
                       "compare frames of one size");
    return frame;
  };
  return set;
}

// Of which two frames of one camera differ by multiples, whatever their black level.
double step_between(const Image& a, const Image& b) {
  constexpr float kRounding = 0.01f;  // of single precision, where the black level is not whole
  Image difference = difference_of(a, b);
  for (float& v : difference.values())
    if (const float whole = std::round(v); std::abs(v - whole) < kRounding) v = whole;
  const Estimate<ValueGrid> grid = value_grid(difference);
  return grid ? grid->step : 0.0;
}

}  // namespace

Image NoiseGround::noise_of(Image frame) const {
  return base.empty() ? std::move(frame) : difference_of(frame, base, scale);
}

ComparedFrames::ComparedFrames(const NoiseFrames& set, const std::optional<Image>& clean, int group,
                               const char* name, Progress& progress)
    : set_(of_one_size(set, name)), clean_(clean), group_(group), name_(name) {
  if (group_ == 0)
    whole_ = {clean.value_or(Image()), clean.value_or(Image())};
  else
    whole_ = mean_ground(0, set_.count, false, progress);
}

Image ComparedFrames::frame(int k) const {
  Image frame = set_.load(k);
  // A mean frame has the frames' size; the clean picture may not.
  if (clean_ && (frame.rows() != clean_->rows() || frame.cols() != clean_->cols()))
    throw InputError(name_,
                     fmt::format("frame {} has {} x {} pixels, the clean picture {} x {}", k,
                                 frame.cols(), frame.rows(), clean_->cols(), clean_->rows()),
                     "use frames of one size and their clean picture");
  return frame;
}

double ComparedFrames::step_dn(const Image& first) const {
  if (set_.count > 1) return step_between(first, frame(1));
  const Estimate<ValueGrid> grid = value_grid(first);
  return grid ? grid->step : 0.0;
}

void ComparedFrames::round_to(Image codes_dn, double step_dn) {
  MALUS_REQUIRE(step_dn > 0);
  codes_dn_ = std::move(codes_dn);
  rounded_step_dn_ = step_dn;
}

Image ComparedFrames::counted(Image frame) const {
  if (!rounded()) return frame;
  MALUS_REQUIRE(frame.size() == codes_dn_.size());
  for (std::size_t i = 0; i < frame.size(); ++i) {
    const float known = codes_dn_.values()[i];
    const double code = std::isfinite(known) ? double{known} : 0.0;
    float& value = frame.values()[i];
    // Finer codes may lie midway between two of these: to the even one, by turns up and down.
    value = static_cast<float>(
        code + rounded_step_dn_ * std::nearbyint((double{value} - code) / rounded_step_dn_));
  }
  return frame;
}

const NoiseGround& ComparedFrames::of_group(int k, Progress& progress) {
  if (group_ == 0 || (group_ == set_.count && !rounded())) return whole_;
  const int first = std::min(k / group_ * group_, set_.count - group_);
  if (first != first_) of_group_ = mean_ground(first, group_, rounded(), progress);
  first_ = first;
  return of_group_;
}

NoiseGround ComparedFrames::mean_ground(int first, int count, bool rounded,
                                        Progress& progress) const {
  std::vector<double> sum;
  Image mean;
  for (int k = 0; k < count; ++k) {
    check_stop(progress);
    Image frame = set_.load(first + k);
    if (rounded) frame = counted(std::move(frame));
    if (k == 0) mean = Image(frame.rows(), frame.cols()), sum.resize(frame.size());
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += frame.values()[i];
  }
  for (std::size_t i = 0; i < sum.size(); ++i)
    mean.values()[i] = static_cast<float>(sum[i] / count);
  // The mean holds 1/n of each frame's own noise; this gives the residual its variance back.
  const auto scale = static_cast<float>(std::sqrt(count / (count - 1.0)));
  Image signal = clean_ ? *clean_ : mean;
  return {std::move(mean), std::move(signal), scale};
}

}  // namespace malus
