#include "malus/denoise/internal/mosaic_filter.h"

#include "malus/base/parallel.h"
#include "malus/denoise/internal/block_mix.h"
#include "malus/denoise/internal/detail_shrinkage.h"
#include "malus/denoise/internal/pilot_doubt.h"
#include "malus/denoise/internal/stack_kernel.h"
#include "malus/denoise/internal/stated_error.h"

#include <algorithm>
#include <cmath>

namespace malus {
namespace {

using internal::CellMatrix;
using internal::CellVector;
using internal::kCell;
using internal::kLanes;

// Every pixel is the mean of the linear estimates of the cells around it.
Image smoothed(const internal::StackTile& noisy, const CellStatistics& statistics) {
  const Image& from = noisy.pixels;
  // One more cell than the tile on the far sides would be needed for its last pixels: those keep
  // their own value. They lie in the extension, beyond all results.
  Image sum(from.rows(), from.cols());
  internal::SmoothJob job{};
  job.noisy = from.values().data();
  job.sum = sum.values().data();
  job.stride = from.cols();
  job.cols = from.cols();
  job.row0 = noisy.row0;
  job.col0 = noisy.col0;
  job.period_rows = statistics.period_rows;
  job.period_cols = statistics.period_cols;
  job.means = statistics.means.data();
  job.matrices = statistics.smoothing.data();
  // Bands of cells in two groups: cells of one band reach two rows into the next. Lattice and bands
  // belong to the frame, not to the tile, so that sums have the same order in every tile.
  constexpr int kBand = 32;
  MALUS_REQUIRE(noisy.row0 % internal::kGuideStep == 0 && noisy.col0 % internal::kGuideStep == 0);
  const int last = from.rows() - kCell + 1;
  const int first_band = internal::floor_div(noisy.row0, kBand);
  const int bands = internal::floor_div(noisy.row0 + last - 1, kBand) - first_band + 1;
  for (int parity = 0; parity < 2; ++parity)
    parallel_for(0, bands, 1, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
      for (int b = first_band + static_cast<int>(begin); b < first_band + static_cast<int>(end);
           ++b)
        if ((b & 1) == parity)
          internal::smooth_cells(job, std::max(b * kBand - noisy.row0, 0),
                                 std::min((b + 1) * kBand - noisy.row0, last));
    });
  const auto covers = [](int position, int size) {
    // Cells of the lattice that hold this position.
    int count = 0;
    for (int start = position - position % internal::kGuideStep;
         start > position - kCell && start >= 0; start -= internal::kGuideStep)
      if (start + kCell <= size) ++count;
    return count;
  };
  std::vector<int> across;
  for (int c = 0; c < from.cols(); ++c) across.push_back(covers(c, from.cols()));
  parallel_for(0, from.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
      const int down = covers(r, from.rows());
      for (int c = 0; c < from.cols(); ++c) {
        const int count = down * across[static_cast<std::size_t>(c)];
        sum(r, c) = count > 0 ? sum(r, c) / static_cast<float>(count) : from(r, c);
      }
    }
  });
  return sum;
}

// to += share * (other - to)
void blend(Image& to, const Image& other, float share) {
  parallel_for(0, to.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < to.cols(); ++c) to(r, c) += share * (other(r, c) - to(r, c));
  });
}

// A pass by small blocks, and by large ones where these leave less error, as Stein's estimates
// tell.
Image mixed_pass(const internal::StageInput& input, const internal::StackStage& small,
                 const internal::StackStage& large, internal::ReferenceMap* settled,
                 Progress& progress) {
  internal::FilteredTile by_small, by_large;
  by_small.pixels =
      internal::run_stage(input, small, progress, {.stein = &by_small.error, .settled = settled});
  by_large.pixels = internal::run_stage(input, large, progress, {.stein = &by_large.error});
  internal::mix_blocks(by_small, by_large, input.noisy->row0, input.noisy->col0);
  return std::move(by_small.pixels);
}

// How far the guide of `input`, the first pilot, is doubted; of plans without a survey nothing.
internal::ReferenceMap survey_pilot(const internal::StageInput& input, const MosaicFilterPlan& plan,
                                    Progress& progress) {
  if (!plan.survey) return {};
  internal::PilotEvidence evidence;
  internal::run_stage(input, *plan.survey, progress, {.evidence = &evidence});
  return internal::doubt_of(evidence);
}

// A guided pass of `input`, whose guide is `pilot` and whose doubt, if any, is `doubt`. After the
// first one the doubt is what its stacks have made of it.
void refine_pilot(const internal::StageInput& input, const MosaicFilterPlan& plan, std::size_t pass,
                  Image& pilot, internal::ReferenceMap& doubt, Progress& progress) {
  const internal::StackStage& stage = plan.guided[pass];
  internal::ReferenceMap settled;
  const bool settles = pass == 0 && input.doubt && stage.filter == internal::StackFilter::wiener;
  internal::ReferenceMap* to = settles ? &settled : nullptr;
  pilot = pass == 0 && plan.large ? mixed_pass(input, stage, *plan.large, to, progress)
                                  : internal::run_stage(input, stage, progress, {.settled = to});
  if (!settles) return;
  for (float& value : settled.values.values())
    if (value == 0) value = 1;
  doubt = std::move(settled);
}

}  // namespace

int folded(int position, int size, int period) {
  if (position >= 0 && position < size) return position;
  const int cell = internal::floor_div(position, period);
  const int phase = position - cell * period;
  const int count = (size - phase + period - 1) / period;
  if (phase >= size || count <= 0)
    return size - 1;  // no sample of this channel: the nearest there is
  const int turn = 2 * count;
  int mirrored = ((cell % turn) + turn) % turn;
  if (mirrored >= count) mirrored = turn - 1 - mirrored;
  return mirrored * period + phase;
}

internal::StackTile cut_tile(const FrameSource& frame, int row0, int col0, int rows, int cols) {
  internal::StackTile tile{Image(rows, cols), row0, col0};
  std::vector<int> source_col;
  for (int c = 0; c < cols; ++c)
    source_col.push_back(folded(col0 + c, frame.cols, frame.layout.cols()));
  parallel_for(0, rows, 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r) {
      const int row = folded(row0 + r, frame.rows, frame.layout.rows());
      float* to = tile.pixels.row(r);
      for (int c = 0; c < cols; ++c)
        to[c] = frame.pixel(row, source_col[static_cast<std::size_t>(c)]);
    }
  });
  return tile;
}

Image filter_mosaic(const internal::StackTile& noisy, int frame_rows, int frame_cols,
                    const CellStatistics& statistics, const MosaicFilterPlan& plan,
                    Progress& progress, const TileReport& report) {
  internal::StageInput input{};
  input.noisy = &noisy;
  input.period_rows = statistics.period_rows;
  input.period_cols = statistics.period_cols;
  input.frame_rows = frame_rows;
  input.frame_cols = frame_cols;
  input.rotations = &statistics.rotations;
  input.axes_prior = &statistics.axes_prior;
  if (plan.repeats) input.repeats = &statistics.repeats;
  MALUS_REQUIRE(!plan.hard.empty() && plan.guided.size() >= (plan.large ? 2 : 1));
  Image pilot;
  {
    const Image guide = smoothed(noisy, statistics);
    input.guide = &guide;
    pilot = internal::run_stage(input, plan.hard.front(), progress);
    for (std::size_t i = 1; i < plan.hard.size(); ++i)
      blend(pilot, internal::run_stage(input, plan.hard[i], progress),
            1.0f / static_cast<float>(i + 1));
  }
  input.guide = &pilot;
  internal::ReferenceMap doubt = survey_pilot(input, plan, progress);
  if (plan.survey) input.doubt = &doubt;
  for (std::size_t pass = 0; pass + 1 < plan.guided.size(); ++pass)
    refine_pilot(input, plan, pass, pilot, doubt, progress);
  doubt = internal::halved(std::move(doubt));
  const bool shrinks = plan.detail_threshold > 0;
  internal::ReferenceMap passed;
  std::optional<internal::CellMap> kept, own_unlike;
  internal::CellMap* unlike = report.unlike;
  if (report.variance && !unlike) unlike = &own_unlike.emplace(noisy);
  internal::StackTile estimate{
      internal::run_stage(
          input, plan.guided.back(), progress,
          {.noise = report.variance, .passed = shrinks ? &passed : nullptr, .unlike = unlike}),
      noisy.row0, noisy.col0};
  if (shrinks) {
    if (report.variance) kept.emplace(noisy);
    estimate.pixels =
        internal::shrink_detail(estimate, frame_rows, frame_cols, statistics.rotations.front(),
                                passed, plan.detail_threshold, kept ? &*kept : nullptr);
  }
  if (report.variance)
    internal::state_error({.noisy = &noisy,
                           .estimate = &estimate.pixels,
                           .kept = kept ? &*kept : nullptr,
                           .unlike = unlike,
                           .coarse_unlike = report.coarse_unlike,
                           .doubt = plan.survey ? &doubt : nullptr,
                           .filter = plan.guided.back().filter,
                           .period_rows = statistics.period_rows,
                           .period_cols = statistics.period_cols,
                           .frame_rows = frame_rows,
                           .frame_cols = frame_cols},
                          *report.variance);
  return std::move(estimate.pixels);
}

}  // namespace malus
