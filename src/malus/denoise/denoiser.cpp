#include "malus/denoise/denoiser.h"

#include "malus/base/parallel.h"
#include "malus/base/text.h"
#include "malus/denoise/internal/baselines.h"
#include "malus/denoise/mosaic_filter.h"
#include "malus/denoise/prepared_frame.h"

#include <algorithm>
#include <chrono>
#include <cmath>

#include <fmt/format.h>

namespace malus {
namespace {

using Clock = std::chrono::steady_clock;

constexpr double kBytesPerTilePixel = 28;  // tile, guide, pilot, sums, weights, error
constexpr int kLeastCore = 128;

// A part of the frame that is filtered at once; the results are the same whatever its size.
struct TilePlan {
  int core_rows, core_cols;
};

TilePlan plan_tiles(int rows, int cols, int reach, const DenoiseSettings& settings,
                    int frame_images) {
  const double frame_bytes = 4.0 * rows * static_cast<double>(cols);
  const double pixels =
      (settings.memory_mib * 0x1p20 - frame_images * frame_bytes) / kBytesPerTilePixel;
  if ((rows + 2.0 * reach) * (cols + 2.0 * reach) <= pixels) return {rows, cols};
  const double side = std::sqrt(std::max(pixels, 0.0)) - 2.0 * reach;
  const double least = (kLeastCore + 2.0 * reach) * (kLeastCore + 2.0 * reach);
  if (side < kLeastCore)
    throw InputError(
        "--memory",
        fmt::format("{:.0f} MiB is too little for a frame of {} x {} pixels", settings.memory_mib,
                    cols, rows),
        fmt::format("give at least {:.0f} MiB",
                    std::ceil((least * kBytesPerTilePixel + frame_images * frame_bytes) / 0x1p20)));
  const int core = static_cast<int>(side) / 2 * 2;  // tiles begin at even pixels
  return {core, core};
}

// Writes the core of a filtered tile into the results.
void store_tile(const internal::StackTile& tile, const Image& filtered, const Image* variance,
                int margin, int rows, int cols, const std::vector<Stabilizer>& stabilizers,
                const PreparedFrame& frame, Denoised& result) {
  parallel_for(0, rows, 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < cols; ++c) {
        const int row = tile.row0 + margin + r, col = tile.col0 + margin + c;
        const Stabilizer& stabilizer =
            stabilizers[static_cast<std::size_t>(frame.layout.channel_at(row, col))];
        const double value = filtered(margin + r, margin + c);
        // A saturated pixel is at least as bright as it says: nothing better is known.
        const bool saturated = frame.dn(row, col) >= frame.saturated_dn;
        result.dn_above_black(row, col) =
            saturated ? frame.dn(row, col) : static_cast<float>(stabilizer.inverse(value));
        if (variance) {
          const double slope = stabilizer.inverse_slope(value);
          (*result.variance_dn2)(row, col) =
              static_cast<float>((*variance)(margin + r, margin + c) * slope * slope);
        }
      }
  });
}

}  // namespace

void filter_prepared(const PreparedFrame& frame, const NoiseProfile& profile,
                     const DenoiseSettings& settings, Progress& progress, Denoised& result) {
  result.dn_above_black = Image(frame.dn.rows(), frame.dn.cols());
  const SensorLayout& layout = frame.layout;
  const int rows = frame.dn.rows(), cols = frame.dn.cols();
  const auto stabilizers = make_stabilizers(profile, frame.saturated_dn, settings.strength);
  const PixelSource pixel = [&](int r, int c) {
    return static_cast<float>(
        stabilizers[static_cast<std::size_t>(layout.channel_at(r, c))].forward(frame.dn(r, c)));
  };
  const MosaicFilterPlan plan = mosaic_filter_plan(settings.profile);
  const CellStatistics statistics = measure_cells(pixel, rows, cols, layout);
  const int reach = mosaic_filter_reach(plan, layout);
  const TilePlan tiles = plan_tiles(rows, cols, reach, settings, result.variance_dn2 ? 3 : 2);
  const int down = (rows + tiles.core_rows - 1) / tiles.core_rows;
  const int across = (cols + tiles.core_cols - 1) / tiles.core_cols;
  result.tiles = down * across;
  progress.begin("denoising", result.tiles);
  for (int t = 0; t < result.tiles; ++t) {
    const int row0 = t / across * tiles.core_rows, col0 = t % across * tiles.core_cols;
    const int core_rows = std::min(tiles.core_rows, rows - row0);
    const int core_cols = std::min(tiles.core_cols, cols - col0);
    const internal::StackTile tile = cut_tile(pixel, rows, cols, row0 - reach, col0 - reach,
                                              core_rows + 2 * reach, core_cols + 2 * reach, layout);
    Image variance;
    const Image filtered = filter_mosaic(tile, rows, cols, statistics, plan, progress,
                                         result.variance_dn2 ? &variance : nullptr);
    store_tile(tile, filtered, result.variance_dn2 ? &variance : nullptr, reach, core_rows,
               core_cols, stabilizers, frame, result);
    progress.advance(1);
  }
}

const std::vector<DenoiseMethod>& denoise_methods() {
  static const std::vector<DenoiseMethod> methods = {
      {"bm3d", "calibrated, joint over all channels, adaptive to local colour and polarization",
       true},
      {"vst-pca-bm3d", "baseline: stabilised, principal components, each filtered alone", false},
      {"vst-bm3d", "baseline: stabilised, each plane filtered alone", false},
      {"paper-mbm3d", "baseline: all planes jointly with one estimated deviation", false},
      {"paper-bm3d", "baseline: each plane alone with its estimated deviation", false},
  };
  return methods;
}

const DenoiseMethod& denoise_method(const std::string& name) {
  std::vector<std::string> names;
  for (const DenoiseMethod& method : denoise_methods()) {
    if (method.name == name) return method;
    names.push_back(method.name);
  }
  throw InputError("--method " + name, "is not known; there are " + joined(names),
                   "did you mean " + nearest_name(name, names) + "?");
}

Denoised denoise_frame(RawFrame frame, const NoiseProfile& profile, const DenoiseSettings& settings,
                       Progress& progress, bool want_variance) {
  const DenoiseMethod& method = denoise_method(settings.method);
  check_frame(frame, profile);
  if (want_variance && !method.gives_variance)
    throw InputError("--method " + method.name, "gives no uncertainty", "use bm3d");
  Denoised result;
  const auto start = Clock::now();
  const bool default_method = method.name == denoise_methods().front().name;
  const PreparedFrame prepared =
      prepare_frame(std::move(frame), profile, settings.row_noise && default_method, result);
  const auto filter_start = Clock::now();
  if (want_variance) result.variance_dn2 = Image(prepared.dn.rows(), prepared.dn.cols());
  if (default_method)
    filter_prepared(prepared, profile, settings, progress, result);
  else
    result.dn_above_black =
        internal::run_baseline(method.name, prepared, profile, settings, progress);
  restore_nonfinite(prepared, result);
  const auto seconds = [](auto from, auto to) {
    return std::chrono::duration<double>(to - from).count();
  };
  result.times = {{"preparation and row noise", seconds(start, filter_start)},
                  {"filter", seconds(filter_start, Clock::now())}};
  return result;
}

}  // namespace malus
