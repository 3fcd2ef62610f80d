#include "malus/denoise/internal/bm3d_mix.h"

#include "malus/base/parallel.h"
#include "malus/denoise/bm3d.h"
#include "malus/denoise/denoiser.h"
#include "malus/denoise/internal/gaussian_means.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace malus::internal {
namespace {

// All measured (docs/denoising-experiments.md, "One channel"). Of the neighbourhood that decides,
// in cells.
constexpr float kMixDeviation = 2.0f;
constexpr int kMixRadius = 5;
constexpr int kMixContext = (kMixRadius + 1) * kCell;  // pixels
// Of the estimate's stated error, what its own noise is: it is stated a little too large.
constexpr float kOwnOfStated = 0.85f;
// Where little is known half of either is best; that counts for as much as a difference between the
// two of kPriorErrors times the error.
constexpr float kPriorShare = 0.5f, kPriorErrors = 1.0f;
// Of smooth light, where BM3D's error is stated this many times as large, nothing is taken: its
// matching follows the noise, and Stein's estimate does not see that.
constexpr float kMostRatio = 1.25f;
constexpr float kLeastLeft = 0.3f;  // of the error by a mix
// What BM3D holds per pixel: samples, result, its error, padded samples and pilot, three sums.
constexpr double kBytesPerPixel = 36;

// Along one axis: the part, what decides about it, and what BM3D sees, which begins on its lattice.
struct MixSpan {
  int begin, end, context_begin, context_end, tile_begin, tile_end;
  MixSpan(int part, int size, int frame, const Bm3dReach& reach)
      : begin(part * size),
        end(std::min(begin + size, frame)),
        context_begin(std::max(begin - kMixContext, 0)),
        context_end(std::min(end + kMixContext, frame)),
        tile_begin(std::max(begin - on_lattice(reach), 0)),
        tile_end(std::min(context_end + reach.pixels, frame)) {}
  static int on_lattice(const Bm3dReach& reach) {
    return (kMixContext + reach.pixels + reach.grid - 1) / reach.grid * reach.grid;
  }
};

int part_count(int frame, int size) { return (frame + size - 1) / size; }

// Share of BM3D's estimate.
float share_of(float gain, float energy, float error, float plain_error) {
  const float prior = kPriorErrors * std::min(error, plain_error);
  const float best = (gain + kPriorShare * prior) / std::max(energy + prior, 1e-9f);
  const float ratio = std::min(plain_error / std::max(kMostRatio * error, 1e-6f), 4.0f);
  const float cut = std::pow(ratio, 16.0f);
  return std::clamp(best, 0.0f, 1.0f) / (1 + cut);
}

class Mixing {
 public:
  Mixing(const Bm3dMix& mix, const PixelSource& pixel, Image& cell_error, Image& estimate,
         Progress& progress)
      : mix_(mix),
        reach_(malus::bm3d_reach({.profile = mix.profile})),
        pixel_(pixel),
        cell_error_(cell_error),
        mixed_error_(cell_error),
        estimate_(estimate),
        progress_(progress) {}

  void run() {
    Image before;  // the estimate before the change, of a band and its context
    int first_row = 0;
    for (int i = 0; i < part_count(estimate_.rows(), mix_.part_rows); ++i) {
      const MixSpan down(i, mix_.part_rows, estimate_.rows(), reach_);
      Image band(down.context_end - down.context_begin, estimate_.cols());
      for (int r = down.context_begin; r < down.context_end; ++r)
        std::copy_n(r < down.begin ? before.row(r - first_row) : estimate_.row(r), band.cols(),
                    band.row(r - down.context_begin));
      before = std::move(band);
      first_row = down.context_begin;
      for (int k = 0; k < part_count(estimate_.cols(), mix_.part_cols); ++k)
        mix_part(down, MixSpan(k, mix_.part_cols, estimate_.cols(), reach_), before);
    }
    cell_error_ = std::move(mixed_error_);
  }

 private:
  void mix_part(const MixSpan& down, const MixSpan& across, const Image& before) {
    Planes samples(1, down.tile_end - down.tile_begin, across.tile_end - across.tile_begin);
    parallel_for(0, samples.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
        for (int c = 0; c < samples.cols(); ++c)
          samples[0](r, c) = pixel_(down.tile_begin + r, across.tile_begin + c);
    });
    const float deviation = 1;
    Planes error;
    const Planes plain =
        bm3d(samples, {&deviation, 1}, {.profile = mix_.profile}, {}, progress_, &error);
    const int row0 = down.context_begin - down.tile_begin,
              col0 = across.context_begin - across.tile_begin;
    const int rows = down.context_end - down.context_begin,
              cols = across.context_end - across.context_begin;
    const auto part_of = [&](const Planes& planes) {
      return planes[0].view().window(row0, col0, rows, cols);
    };
    const View<const float> own = before.view().window(0, across.context_begin, rows, cols);
    const MixShares shares = find_shares(part_of(samples), own, part_of(plain), part_of(error),
                                         error_around(down, across));
    take(shares.share, down, across, own, part_of(plain));
    state_error(shares.left, down, across);
  }

  // The estimate's error around the cells of a context.
  Image error_around(const MixSpan& down, const MixSpan& across) const {
    Image error(cell_count(down.context_end - down.context_begin),
                cell_count(across.context_end - across.context_begin));
    for (int i = 0; i < error.rows(); ++i)
      std::copy_n(cell_error_.row(down.context_begin / kCell + i) + across.context_begin / kCell,
                  error.cols(), error.row(i));
    return gaussian_means(error, kMixDeviation, kMixRadius);
  }

  // One value per cell.
  struct MixShares {
    Image share;  // of BM3D's estimate
    Image left;   // by the mix of the estimate's error
  };
  // own_error: error_around; plain_error: of BM3D's pixels.
  static MixShares find_shares(const View<const float>& samples, const View<const float>& own,
                               const View<const float>& plain, const View<const float>& plain_error,
                               const Image& own_error) {
    const auto means = [&](const auto& value) {
      Image map(own_error.rows(), own_error.cols());
      parallel_for(0, map.rows(), 8, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
        for (int i = static_cast<int>(begin); i < static_cast<int>(end); ++i)
          for (int k = 0; k < map.cols(); ++k)
            map(i, k) = cell_mean(i, k, own.rows(), own.cols(), value);
      });
      return gaussian_means(map, kMixDeviation, kMixRadius);
    };
    const auto change = [&](int r, int c) { return plain(r, c) - own(r, c); };
    Image share = means([&](int r, int c) { return (samples(r, c) - own(r, c)) * change(r, c); });
    const Image energy = means([&](int r, int c) { return change(r, c) * change(r, c); });
    const Image error = means([&](int r, int c) { return plain_error(r, c); });
    Image left(share.rows(), share.cols());
    for (int i = 0; i < share.rows(); ++i)
      for (int k = 0; k < share.cols(); ++k) {
        const float gain = share(i, k) - (error(i, k) - kOwnOfStated * own_error(i, k));
        const float taken = share_of(gain, energy(i, k), own_error(i, k), error(i, k));
        const float gained = taken * (2 * gain - taken * energy(i, k));
        share(i, k) = taken;
        left(i, k) = std::clamp(1 - gained / std::max(own_error(i, k), 1e-9f), kLeastLeft, 1.0f);
      }
    return {std::move(share), std::move(left)};
  }

  void state_error(const Image& left, const MixSpan& down, const MixSpan& across) {
    const int row0 = down.context_begin / kCell, col0 = across.context_begin / kCell;
    for (int i = down.begin / kCell; i < cell_count(down.end); ++i)
      for (int k = across.begin / kCell; k < cell_count(across.end); ++k)
        mixed_error_(i, k) *= left(i - row0, k - col0);
  }

  void take(const Image& share, const MixSpan& down, const MixSpan& across,
            const View<const float>& own, const View<const float>& plain) {
    parallel_for(down.begin, down.end, kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
        for (int c = across.begin; c < across.end; ++c) {
          const int row = r - down.context_begin, col = c - across.context_begin;
          estimate_(r, c) += share(row / kCell, col / kCell) * (plain(row, col) - own(row, col));
        }
    });
  }

  const Bm3dMix& mix_;
  Bm3dReach reach_;
  const PixelSource& pixel_;
  Image& cell_error_;
  Image mixed_error_;
  Image& estimate_;
  Progress& progress_;
};

}  // namespace

bool mixes_bm3d(const std::string& method, const std::string& profile, const SensorLayout& layout) {
  return denoise_method(method).filter == MosaicFilter::kRidge &&
         denoise_profile(profile) != DenoiseProfile::kFast && layout.rows() == 1 &&
         layout.cols() == 1;
}

Bm3dMix plan_bm3d_mix(const std::string& profile, int rows, int cols, const MemoryBudget& memory) {
  const Bm3dReach reach = malus::bm3d_reach({.profile = profile});
  const double bytes = memory.bytes();
  const auto needed = [&](int part_rows, int part_cols) {
    const double around = MixSpan::on_lattice(reach) + kMixContext + reach.pixels;
    return kBytesPerPixel * std::min<double>(part_rows + around, rows) *
               std::min<double>(part_cols + around, cols) +
           8.0 * cols * std::min(part_rows + 2 * kMixContext, rows);
  };
  if (needed(rows, cols) <= bytes) return {profile, rows, cols};
  int side = reach.grid;
  if (needed(side, side) > bytes) memory.refuse(needed(side, side), rows, cols);
  while (needed(side + reach.grid, side + reach.grid) <= bytes) side += reach.grid;
  return {profile, side, side};
}

void mix_bm3d(const Bm3dMix& mix, const PixelSource& pixel, Image& cell_error, Image& estimate,
              Progress& progress) {
  Mixing(mix, pixel, cell_error, estimate, progress).run();
}

}  // namespace malus::internal
