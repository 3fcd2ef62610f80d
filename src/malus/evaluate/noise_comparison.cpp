#include "malus/evaluate/noise_comparison.h"

#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/base/statistics.h"
#include "malus/base/wording.h"
#include "malus/evaluate/divergence.h"
#include "malus/evaluate/image_metrics.h"
#include "malus/evaluate/internal/common_offsets.h"
#include "malus/evaluate/internal/compared_frames.h"
#include "malus/evaluate/noise_cautions.h"
#include "malus/evaluate/noise_structure.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

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
  }
  return result;
}

// Values are offset + n unit / parts. 0: they are no such numbers.
struct Lattice {
  double unit = 0;
  int parts = 1;
  double offset = 0;
};

// The codes that all pixels of one frame's noise have in common; none where black levels or the
// clean scene moved them apart.
std::optional<Lattice> common_lattice(const Image& noise, double step_dn) {
  constexpr double kRounding = 0.01;                     // of single precision
  constexpr double kLooseFrom = 16, kLoosely = 1.0 / 8;  // as of a loose ValueGrid
  const double most = step_dn >= kLooseFrom ? kLoosely * step_dn : kRounding;
  std::optional<Lattice> lattice;
  for (const double x : noise.values()) {
    if (!std::isfinite(x)) continue;
    if (!lattice) lattice = Lattice{step_dn, 1, x};
    const double steps = (x - lattice->offset) / step_dn;
    if (step_dn * std::abs(steps - std::round(steps)) > most) return std::nullopt;
  }
  return lattice;
}

// Frames of one side in codes, and how the other's are counted beside them.
struct CommonCodes {
  double step_dn = 0;  // 0: neither side is in codes
  double reference_rounded_dn = 0, test_rounded_dn = 0;
};

// Where one side is in codes, the other is rounded as they are: what a step hides in the one is
// hidden in both. The sides' first frames tell the codes.
CommonCodes take_common_codes(const Image& first_of_reference, const Image& first_of_test,
                              ComparedFrames& reference, ComparedFrames& test) {
  const double of_reference = reference.step_dn(first_of_reference),
               of_test = test.step_dn(first_of_test);
  CommonCodes codes{std::max(of_reference, of_test)};
  if (of_reference < codes.step_dn) {
    reference.round_to(first_of_test, codes.step_dn);
    codes.reference_rounded_dn = codes.step_dn;
  } else if (of_test < codes.step_dn) {
    test.round_to(first_of_reference, codes.step_dn);
    codes.test_rounded_dn = codes.step_dn;
  }
  return codes;
}

// Bins of another width than whole steps are a comb over the codes. Less their mean, codes are
// multiples of a step's n-th of which a pixel has one in every step.
Lattice lattice_of(double step_dn, const NoiseGround& ground, int group, const Image& noise_a,
                   const Image& noise_b) {
  if (!(step_dn > 0)) return {};
  if (group > 0) return {step_dn * static_cast<double>(ground.scale), group};
  const std::optional<Lattice> of_a = common_lattice(noise_a, step_dn);
  return of_a ? *of_a : common_lattice(noise_b, step_dn).value_or(Lattice{});
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
    low = lattice.offset + unit * (std::floor((low - lattice.offset) / unit) - 0.5 - beside);
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
std::vector<Counts> histograms_of(ComparedFrames& source, const Bins& levels,
                                  const std::vector<Bins>& bins, StructureSums& structure,
                                  CommonOffsets& offsets, Progress& progress) {
  std::vector<Counts> counts;
  for (const Bins& b : bins) counts.emplace_back(static_cast<std::size_t>(b.count));
  for (int k = 0; k < source.count(); ++k) {
    check_stop(progress);
    const Image frame = source.frame(k);
    const NoiseGround& ground = source.of_group(k, progress);
    const Image noise = ground.noise_of(source.counted(frame));
    if (&ground == &source.whole() && !source.rounded())
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

// What the sides' first frames tell of their light, and nothing else yet.
NoiseComparison light_of(const Image& reference, const Image& test,
                         const std::optional<Image>& clean_dn, const SensorLayout& layout) {
  NoiseComparison result;
  if (!clean_dn) return result;
  if (const auto light = light_over_clean(reference, *clean_dn, layout))
    result.reference_light = *light;
  if (const auto light = light_over_clean(test, *clean_dn, layout)) result.test_light = *light;
  return result;
}

void require_finite(const MomentsByLevel& a, const MomentsByLevel& b) {
  if (a.signal.count() < 2 || b.signal.count() < 2)
    throw InputError("the frames", "hold no finite pixels", "check what was written into them");
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
  ComparedFrames a(reference, clean_dn, group, "the reference frames", progress);
  ComparedFrames b(test, clean_dn, group, "the test frames", progress);
  Image first_a = a.frame(0), first_b = b.frame(0);  // in this order: the reference is named first
  require_one_size(first_a, first_b);
  NoiseComparison result = light_of(first_a, first_b, clean_dn, layout);
  const CommonCodes codes = take_common_codes(first_a, first_b, a, b);
  const NoiseGround &ground_a = a.of_group(0, progress), &ground_b = b.of_group(0, progress);
  const Image noise_a = ground_a.noise_of(a.counted(std::move(first_a)));
  const Image noise_b = ground_b.noise_of(b.counted(std::move(first_b)));
  const bool uniform = ground_a.signal.empty();  // one level, the same as pooled
  const Bins levels = uniform ? Bins{} : levels_of(ground_a.signal, settings.levels);
  const MomentsByLevel moments_a = moments_of(noise_a, ground_a.signal, levels);
  const MomentsByLevel moments_b = moments_of(noise_b, ground_b.signal, levels);
  require_finite(moments_a, moments_b);
  const std::vector<Bins> bins =
      bins_of_levels(moments_a, moments_b,
                     lattice_of(codes.step_dn, ground_a, group, noise_a, noise_b), settings.bins);
  progress.begin("noise", a.count() + b.count());
  StructureSums structure_a(layout), structure_b(layout);
  CommonOffsets offsets_a(bins.size(), noise_a.rows()), offsets_b = offsets_a;
  const auto counts_a = histograms_of(a, levels, bins, structure_a, offsets_a, progress);
  const auto counts_b = histograms_of(b, levels, bins, structure_b, offsets_b, progress);
  result.reference_rounded_dn = codes.reference_rounded_dn;
  result.test_rounded_dn = codes.test_rounded_dn;
  result.reference = structure_a.result(), result.test = structure_b.result();
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
          jsd_of_spread_bits(result.reference, reference, noise_a,
                             offsets_a.frame_variance_dn2(all)) +
          jsd_of_spread_bits(result.test, test, noise_b, offsets_b.frame_variance_dn2(all)));
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
