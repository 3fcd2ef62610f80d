#include "malus/evaluate/noise_comparison.h"

#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/base/statistics.h"
#include "malus/base/wording.h"
#include "malus/evaluate/divergence.h"
#include "malus/evaluate/image_metrics.h"
#include "malus/evaluate/internal/common_offsets.h"
#include "malus/evaluate/noise_structure.h"
#include "malus/image/frame_statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>

#include <fmt/format.h>

namespace malus {
namespace {

using Counts = std::vector<std::int64_t>;

// Equal bins, of the noise or as levels of the clean signal; samples beyond the ends go to the
// outermost ones.
struct Bins {
  double low = 0, width = 1;
  int count = 1;
  std::size_t of(double x) const {
    const double i = std::floor((x - low) / width);
    return static_cast<std::size_t>(std::clamp(i, 0.0, count - 1.0));
  }
  double centre(int i) const { return low + (i + 0.5) * width; }
};

Image minus(const Image& frame, const Image& clean, float scale = 1) {
  Image noise(frame.rows(), frame.cols());
  for (std::size_t i = 0; i < noise.size(); ++i)
    noise.values()[i] = scale * (frame.values()[i] - clean.values()[i]);
  return noise;
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

Image mean_frame(const NoiseFrames& set, int first, int count, Progress& progress) {
  std::vector<double> sum;
  Image mean;
  for (int k = 0; k < count; ++k) {
    check_stop(progress);
    const Image frame = set.load(first + k);
    if (k == 0) mean = Image(frame.rows(), frame.cols()), sum.resize(frame.size());
    for (std::size_t i = 0; i < sum.size(); ++i) sum[i] += frame.values()[i];
  }
  for (std::size_t i = 0; i < sum.size(); ++i)
    mean.values()[i] = static_cast<float>(sum[i] / count);
  return mean;
}

// The converter's step [DN], of which two frames of one camera differ by multiples, whatever their
// black level; 0 of fractional pixels.
double step_between(const Image& a, const Image& b) {
  constexpr float kRounding = 0.01f;  // of single precision, where the black level is not whole
  Image difference = minus(a, b);
  for (float& v : difference.values())
    if (const float whole = std::round(v); std::abs(v - whole) < kRounding) v = whole;
  const Estimate<ValueGrid> grid = value_grid(difference);
  return grid ? grid->step : 0.0;
}

// What frames are compared with: noise is scale (frame - base). Both empty where the scene is
// uniform.
struct Ground {
  Image base, signal;  // signal sets the level
  float scale = 1;
  Image noise_of(Image frame) const {
    return base.empty() ? std::move(frame) : minus(frame, base, scale);
  }
};

// One side: its frames and their grounds.
class NoiseSource {
 public:
  // group: frames whose mean is the fixed pattern that the histograms go without, no more than
  // there are; 0: it is not removed.
  NoiseSource(const NoiseFrames& set, const std::optional<Image>& clean, int group,
              const char* name, Progress& progress)
      : set_(of_one_size(set, name)), clean_(clean), group_(group), name_(name) {
    if (group_ == 0)
      whole_ = {clean.value_or(Image()), clean.value_or(Image())};
    else
      whole_ = mean_ground(0, set_.count, progress);
  }
  int count() const { return set_.count; }

  Image frame(int k) const {
    Image frame = set_.load(k);
    // A mean frame has the frames' size; the clean picture may not.
    if (clean_ && (frame.rows() != clean_->rows() || frame.cols() != clean_->cols()))
      throw InputError(name_,
                       fmt::format("frame {} has {} x {} pixels, the clean picture {} x {}", k,
                                   frame.cols(), frame.rows(), clean_->cols(), clean_->rows()),
                       "use frames of one size and their clean picture");
    return frame;
  }

  double step_dn() const { return step_between(frame(0), frame(1)); }

  /// Of all frames.
  const Ground& whole() const { return whole_; }

  /// Of the group that frame k is in; the last group reaches back where the count is no multiple.
  const Ground& of_group(int k, Progress& progress) {
    if (group_ == 0 || group_ == set_.count) return whole_;
    const int first = std::min(k / group_ * group_, set_.count - group_);
    if (first != first_) of_group_ = mean_ground(first, group_, progress);
    first_ = first;
    return of_group_;
  }

 private:
  Ground mean_ground(int first, int count, Progress& progress) const {
    Image mean = mean_frame(set_, first, count, progress);
    // The mean holds 1/n of each frame's own noise; this gives the residual its variance back.
    const auto scale = static_cast<float>(std::sqrt(count / (count - 1.0)));
    Image signal = clean_ ? *clean_ : mean;
    return {std::move(mean), std::move(signal), scale};
  }

  NoiseFrames set_;
  const std::optional<Image>& clean_;
  int group_;
  const char* name_;
  Ground whole_, of_group_;
  int first_ = -1;  // frame of of_group_
};

void require_frames(const NoiseFrames& set, bool remove_fixed_pattern, const char* name) {
  if (set.count == 0) throw InputError(name, "no frames", "name at least one");
  if (remove_fixed_pattern && set.count < 2)
    throw InputError(name, "one frame has no mean to subtract",
                     "give two frames or more, or leave out " + setting("remove_fixed_pattern"));
}

Bins levels_of(const Image& signal, int count) {
  std::vector<float> values = signal.values();
  std::erase_if(values, [](float v) { return !std::isfinite(v); });
  if (values.size() < 2) return {};
  std::sort(values.begin(), values.end());
  const auto at = [&](double part) {
    return double{values[static_cast<std::size_t>(part * static_cast<double>(values.size() - 1))]};
  };
  const double low = at(0.005), high = at(0.995);
  if (!(high > low)) return {low - 0.5, 1, 1};
  return {low, (high - low) / count, count};
}

// The last entry gathers all samples.
struct MomentsByLevel {
  std::vector<Moments> noise;
  Moments signal;
  bool whole_numbers = true;

  // One value alone is no sign of rounding.
  bool shows_codes() const { return whole_numbers && noise.back().variance() > 0; }
};

MomentsByLevel moments_of(const Image& noise, const Image& signal, const Bins& levels) {
  MomentsByLevel result;
  result.noise.resize(static_cast<std::size_t>(levels.count) + 1);
  for (std::size_t i = 0; i < noise.size(); ++i) {
    const double x = noise.values()[i], s = signal.empty() ? 0.0 : signal.values()[i];
    if (!std::isfinite(x) || !std::isfinite(s)) continue;
    result.noise[levels.of(s)].add(x);
    result.noise.back().add(x);
    result.signal.add(s);
    result.whole_numbers = result.whole_numbers && x == std::floor(x);
  }
  return result;
}

// Values are multiples of the `parts`-th of this unit. 0: of nothing.
struct Lattice {
  double unit = 0;
  int parts = 1;
};

// Whole numbers: where one side is rounded, the other is counted as if it were, too; bins of
// another width are a comb over the codes. Less their mean, they are multiples of a step's n-th of
// which a pixel has one in every step.
Lattice lattice_of(const NoiseSource& a, const NoiseSource& b, const Ground& ground, int group,
                   const MomentsByLevel& of_a, const MomentsByLevel& of_b) {
  if (group == 0) return {of_a.shows_codes() || of_b.shows_codes() ? 1.0 : 0.0};
  const double step_a = a.step_dn(), step_b = b.step_dn();
  if (!(step_a > 0 && step_b > 0)) return {};
  return {std::max(step_a, step_b) * static_cast<double>(ground.scale), group};
}

Bins bins_of(const Moments& a, const Moments& b, const Lattice& lattice, int count) {
  constexpr double kReach = 6;  // standard deviations
  if (a.count() < 2 || b.count() < 2) return {0, 1, 1};
  const auto reach = [](const Moments& m) { return kReach * std::sqrt(m.variance()); };
  double low = std::min(a.mean() - reach(a), b.mean() - reach(b));
  double high = std::max(a.mean() + reach(a), b.mean() + reach(b));
  if (const double unit = lattice.unit; unit > 0) {
    // A bin holds the same number of values everywhere, or the histogram is a comb; no value lies
    // on an edge, and edges lie midway between whole numbers, for floats that are compared.
    const double beside = lattice.parts > 1 ? 0.25 / lattice.parts : 0;
    low = unit * (std::floor(low / unit) - 0.5 - beside);
    return {low, unit * std::ceil(std::max((high - low) / unit, 1.0) / count), count};
  }
  if (!(high > low)) low -= 0.5, high += 0.5;
  return {low, (high - low) / count, count};
}

std::vector<Bins> bins_of_levels(const MomentsByLevel& a, const MomentsByLevel& b,
                                 const Lattice& lattice, int count) {
  std::vector<Bins> bins;
  for (std::size_t i = 0; i < a.noise.size(); ++i)
    bins.push_back(bins_of(a.noise[i], b.noise[i], lattice, count));
  return bins;
}

// Histograms of one side: one per level and one of all samples, and what these have in common.
std::vector<Counts> histograms_of(NoiseSource& source, const Bins& levels,
                                  const std::vector<Bins>& bins, StructureSums& structure,
                                  CommonOffsets& offsets, Progress& progress) {
  std::vector<Counts> counts;
  for (const Bins& b : bins) counts.emplace_back(static_cast<std::size_t>(b.count));
  for (int k = 0; k < source.count(); ++k) {
    check_stop(progress);
    const Image frame = source.frame(k);
    const Ground& ground = source.of_group(k, progress);
    const Image noise = ground.noise_of(frame);
    if (&ground == &source.whole())
      structure.add(noise);
    else
      structure.add(source.whole().noise_of(frame));
    for (std::size_t i = 0; i < noise.size(); ++i) {
      const double x = noise.values()[i];
      const double s = ground.signal.empty() ? 0.0 : ground.signal.values()[i];
      if (!std::isfinite(x) || !std::isfinite(s)) continue;
      const std::size_t level = levels.of(s);
      const int row = static_cast<int>(i) / noise.cols();
      ++counts[level][bins[level].of(x)];
      ++counts.back()[bins.back().of(x)];
      offsets.add(level, row, x);
      offsets.add(counts.size() - 1, row, x);
    }
    offsets.end_frame();
    progress.advance(1);
  }
  return counts;
}

std::int64_t samples_in(const Counts& counts) {
  std::int64_t sum = 0;
  for (std::int64_t n : counts) sum += n;
  return sum;
}

// offsets_bits: what the two have of offsets that many of their samples share.
NoiseDistance distance_of(const Counts& reference, const Counts& test, const Bins& bins,
                          double signal_dn, double offsets_bits) {
  const double jsd = *jsd_bits(reference, test);
  return {signal_dn,
          bins.width,
          samples_in(reference),
          samples_in(test),
          *kld_nats(test, reference),
          jsd,
          std::sqrt(jsd),
          std::sqrt(std::min(*jsd_floor_bits(reference, test) + offsets_bits, 1.0))};
}

void require_one_size(const Image& reference, const Image& test) {
  if (reference.rows() == test.rows() && reference.cols() == test.cols()) return;
  throw InputError("the test frames",
                   fmt::format("{} x {} pixels against {} x {} of the reference", test.cols(),
                               test.rows(), reference.cols(), reference.rows()),
                   "compare frames of one size");
}

}  // namespace

NoiseComparison compare_noise(const NoiseFrames& reference, const NoiseFrames& test,
                              const std::optional<Image>& clean_dn, const SensorLayout& layout,
                              const NoiseComparisonSettings& settings, Progress& progress) {
  require_settings(settings);
  require_frames(reference, settings.remove_fixed_pattern, "the reference frames");
  require_frames(test, settings.remove_fixed_pattern, "the test frames");
  // A frame less the mean of n is a mixture of n frames' noise: one distribution on both sides only
  // if n is the same.
  const int group = settings.remove_fixed_pattern ? std::min(reference.count, test.count) : 0;
  NoiseSource a(reference, clean_dn, group, "the reference frames", progress);
  NoiseSource b(test, clean_dn, group, "the test frames", progress);
  const Ground &ground_a = a.of_group(0, progress), &ground_b = b.of_group(0, progress);
  const Image first_a = ground_a.noise_of(a.frame(0)), first_b = ground_b.noise_of(b.frame(0));
  require_one_size(first_a, first_b);
  const bool uniform = ground_a.signal.empty();  // one level, the same as pooled
  const Bins levels = uniform ? Bins{} : levels_of(ground_a.signal, settings.levels);
  const MomentsByLevel moments_a = moments_of(first_a, ground_a.signal, levels);
  const MomentsByLevel moments_b = moments_of(first_b, ground_b.signal, levels);
  if (moments_a.signal.count() < 2 || moments_b.signal.count() < 2)
    throw InputError("the frames", "hold no finite pixels", "check what was written into them");
  const std::vector<Bins> bins = bins_of_levels(
      moments_a, moments_b, lattice_of(a, b, ground_a, group, moments_a, moments_b), settings.bins);

  progress.begin("noise", a.count() + b.count());
  StructureSums structure_a(layout), structure_b(layout);
  CommonOffsets offsets_a(bins.size(), first_a.rows()), offsets_b = offsets_a;
  const auto counts_a = histograms_of(a, levels, bins, structure_a, offsets_a, progress);
  const auto counts_b = histograms_of(b, levels, bins, structure_b, offsets_b, progress);
  NoiseComparison result;
  result.reference = structure_a.result();
  result.test = structure_b.result();
  // Frames less their own mean have none that they do not share in the mean.
  const auto of_offsets = [&](std::size_t k) {
    if (group > 0) return 0.0;
    const double variance_dn2 = offsets_a.mean_variance_dn2(k, moments_a.noise[k].variance()) +
                                offsets_b.mean_variance_dn2(k, moments_b.noise[k].variance());
    return jsd_of_offsets_bits(counts_a[k], counts_b[k], bins[k].width, variance_dn2);
  };
  const std::size_t all = bins.size() - 1;
  result.pooled = distance_of(
      counts_a[all], counts_b[all], bins[all], moments_a.signal.mean(),
      of_offsets(all) +
          jsd_of_spread_bits(result.reference, reference, first_a,
                             offsets_a.frame_variance_dn2(all)) +
          jsd_of_spread_bits(result.test, test, first_b, offsets_b.frame_variance_dn2(all)));
  for (int i = 0; i < levels.count && !uniform; ++i) {
    const auto k = static_cast<std::size_t>(i);
    if (samples_in(counts_a[k]) < kEnoughSamples || samples_in(counts_b[k]) < kEnoughSamples ||
        bins[k].count < 2)
      ++result.levels_left_out;
    else
      result.levels.push_back(
          distance_of(counts_a[k], counts_b[k], bins[k], levels.centre(i), of_offsets(k)));
  }
  return result;
}

Estimate<NoiseDistance> compare_scenes(int scenes, const std::function<NoiseOfScene(int)>& load,
                                       int bins) {
  const auto each = [&](const auto& take) {
    for (int k = 0; k < scenes; ++k) {
      const NoiseOfScene noise = load(k);
      for (const Image* side : {&noise.reference, &noise.test})
        for (const double x : side->values())
          if (std::isfinite(x)) take(side == &noise.test, x);
    }
  };
  Moments moments[2];
  each([&](bool test, double x) { moments[test].add(x); });
  if (moments[0].count() < 2 || moments[1].count() < 2)
    return Undecided{"there are no two samples to compare"};
  const Bins common = bins_of(moments[0], moments[1], {}, bins);
  const auto size = static_cast<std::size_t>(common.count);
  Counts counts[2] = {Counts(size), Counts(size)};
  each([&](bool test, double x) { ++counts[test][common.of(x)]; });
  return distance_of(counts[0], counts[1], common, std::numeric_limits<double>::quiet_NaN(), 0.0);
}

Estimate<double> kept_detail_psnr_db(View<const float> mean_dn, View<const float> clean_dn,
                                     const SensorLayout& layout, const std::vector<double>& bias_dn,
                                     double peak_dn) {
  MALUS_REQUIRE(mean_dn.rows() == clean_dn.rows() && mean_dn.cols() == clean_dn.cols() &&
                static_cast<int>(bias_dn.size()) == layout.channels());
  SquaredError squares;
  for (int r = 0; r < clean_dn.rows(); ++r)
    for (int c = 0; c < clean_dn.cols(); ++c) {
      const double error = static_cast<double>(mean_dn(r, c)) -
                           static_cast<double>(clean_dn(r, c)) -
                           bias_dn[static_cast<std::size_t>(layout.channel_at(r, c))];
      if (!std::isfinite(error)) continue;
      squares.sum += error * error;
      ++squares.count;
    }
  return psnr_db(squares, peak_dn);
}

}  // namespace malus
