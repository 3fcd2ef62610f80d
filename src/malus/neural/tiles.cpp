#include "malus/neural/internal/tiles.h"

#include "malus/base/error.h"
#include "malus/neural/internal/kernels.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace malus {
namespace {

using Json = nlohmann::json;

std::int64_t rounded_up(std::int64_t value, std::int64_t multiple) {
  return (value + multiple - 1) / multiple * multiple;
}

// Where nothing exact is possible: enough for the faded seams to vanish, in multiples.
constexpr std::int64_t kFadedOverlap = 32;

// Bytes per pixel of a network's planes and value of its width: of libtorch's layers, and of
// kernels.
struct Bytes {
  double layers, kernels;
};

// Kernels take vectors whole.
TileDemand with_memory(TileDemand demand, bool takes_kernels, std::int64_t width, Bytes bytes) {
  demand.own_kernels = takes_kernels;
  demand.bytes_per_pixel =
      static_cast<double>(width) * (takes_kernels ? bytes.kernels : bytes.layers);
  return demand;
}

// What a network works on: it pads its input to whole multiples.
struct PaddedSides {
  std::int64_t rows, cols;
};
PaddedSides padded_sides(std::int64_t rows, std::int64_t cols, const TileDemand& demand) {
  return {rounded_up(rows, demand.multiple), rounded_up(cols, demand.multiple)};
}

// Position's share in a span whose core is [begin, end): 1 inside, falling over +-half around inner
// edges.
float share(std::int64_t at, std::int64_t begin, std::int64_t end, std::int64_t length,
            std::int64_t half) {
  const auto rise = [&](std::int64_t edge, std::int64_t position) {
    if (half == 0) return position >= edge ? 1.0 : 0.0;
    return std::clamp(
        (static_cast<double>(position - edge + half) + 0.5) / (2.0 * static_cast<double>(half)),
        0.0, 1.0);
  };
  const double from = begin == 0 ? 1.0 : rise(begin, at);
  const double to = end >= length ? 1.0 : 1.0 - rise(end, at);
  return static_cast<float>(std::min(from, to));
}

}  // namespace

TileDemand tile_demand(const NetworkDescription& description, bool on_cpu) {
  const Json s = full_settings(description);
  const auto number = [&](const char* key) { return s.at(key).get<std::int64_t>(); };
  // The bytes are a fifth more than a forward pass takes at most: of 256 x 256 pixels (malus bench
  // --only networks; the layers' from the peers' column), nafnet's layers of a 5-megapixel frame.
  // vectors: what must be a whole number of them.
  const auto faded = [&](std::int64_t multiple, const char* width, std::int64_t vectors,
                         Bytes bytes) {
    return with_memory({multiple, rounded_up(kFadedOverlap, multiple), false},
                       on_cpu && vectors % internal::kLane == 0, number(width), bytes);
  };
  const auto per_head = [&](const char* width, const char* heads) {
    return number(width) / s.at(heads).at(0).get<std::int64_t>();
  };
  if (description.architecture == "unet") {
    // Two 3x3 convolutions per level, 2 (1 + 2 + ... ) pixels on the way down and again, but for
    // the lowest level, on the way up; the pooling grid of the lowest level. Its kernels take any
    // width.
    const std::int64_t lowest = std::int64_t{1} << (number("levels") - 1);
    return with_memory(
        {lowest, rounded_up(2 * (2 * lowest - 1) + 2 * (lowest - 1) + lowest - 1, lowest), true},
        on_cpu, number("width"), {60, 40});
  }
  if (description.architecture == "nafnet") {
    // Its kernels fill any width up to whole vectors.
    const std::int64_t multiple = std::int64_t{1} << s.at("enc_blk_nums").size(),
                       width = number("width");
    return with_memory({multiple, rounded_up(kFadedOverlap, multiple), false}, on_cpu,
                       on_cpu ? internal::whole_lanes(width) : width, {120, 20});
  }
  if (description.architecture == "restormer")
    return faded(8, "dim", per_head("dim", "heads"), {200, 115});
  if (description.architecture == "uformer")
    return faded(number("win_size") << 4, "embed_dim", per_head("embed_dim", "num_heads"),
                 {250, 90});
  return faded(number("window") << (s.at("depths").size() - 1), "dim", per_head("dim", "heads"),
               {200, 66});
}

std::vector<TileSpan> tile_spans(std::int64_t length, std::int64_t core, const TileDemand& demand) {
  MALUS_REQUIRE(length > 0 && core > 0);
  if (core < length) MALUS_REQUIRE(core % demand.multiple == 0);
  std::vector<TileSpan> spans;
  // Ramps of smaller cores would meet, and more than two tiles share a position.
  const std::int64_t half = demand.exact ? 0 : std::min(demand.overlap, core) / 2;
  for (std::int64_t begin = 0; begin < length; begin += core) {
    const std::int64_t end = std::min(begin + core, length);
    TileSpan span{std::max<std::int64_t>(begin - demand.overlap, 0),
                  std::min(end + demand.overlap, length),
                  begin,
                  end,
                  {}};
    for (std::int64_t at = span.begin; at < span.end; ++at)
      span.weight.push_back(share(at, begin, end, length, half));
    spans.push_back(std::move(span));
  }
  return spans;
}

TileCore tile_core(std::int64_t rows, std::int64_t cols, double bytes, int batch,
                   const TileDemand& demand) {
  const std::int64_t pixels = std::llround(bytes / demand.bytes_per_pixel);
  const PaddedSides padded = padded_sides(rows, cols, demand);
  if (padded.rows * padded.cols <= pixels) return {rows, cols};
  const std::int64_t margins = 2 * demand.overlap;
  TileCore best;
  double least_work = std::numeric_limits<double>::infinity();
  for (std::int64_t across = 1; across <= cols; ++across) {
    const std::int64_t core_cols = rounded_up((cols + across - 1) / across, demand.multiple);
    const std::int64_t tile_cols = std::min(core_cols + margins, padded.cols);
    const std::int64_t most_rows = pixels / batch / tile_cols / demand.multiple * demand.multiple;
    const std::int64_t core_rows =
        most_rows >= padded.rows ? padded.rows : most_rows - margins;  // all rows have no margins
    if (core_rows > 0) {
      const std::int64_t tile_rows = std::min(core_rows + margins, padded.rows);
      const std::int64_t down = (rows + core_rows - 1) / core_rows;
      const double work = static_cast<double>(across * down) * static_cast<double>(tile_rows) *
                          static_cast<double>(tile_cols);
      if (work < least_work) best = {std::min(core_rows, rows), std::min(core_cols, cols)};
      least_work = std::min(work, least_work);
    }
    if (core_cols <= demand.multiple) break;
  }
  return best;
}

double least_tile_bytes(std::int64_t rows, std::int64_t cols, int batch, const TileDemand& demand) {
  const PaddedSides padded = padded_sides(rows, cols, demand);
  const std::int64_t side = demand.multiple + 2 * demand.overlap;
  const std::int64_t smallest = std::min(side, padded.rows) * std::min(side, padded.cols);
  return static_cast<double>(std::min(padded.rows * padded.cols, batch * smallest)) *
         demand.bytes_per_pixel;
}

TiledResult run_tiled(const Tiling& tiling,
                      const std::function<torch::Tensor(const TileSpan&, const TileSpan&)>& input,
                      const std::function<torch::Tensor(const torch::Tensor&)>& network,
                      Progress& progress) {
  const auto down = tile_spans(tiling.rows, tiling.core.rows, tiling.demand),
             across = tile_spans(tiling.cols, tiling.core.cols, tiling.demand);
  const int tiles = static_cast<int>(down.size() * across.size());
  progress.begin("denoising", tiles);
  if (tiles == 1) {
    check_stop(progress);
    torch::Tensor whole = network(input(down.front(), across.front()));
    progress.advance(1);
    return {whole.to(torch::kCPU, torch::kFloat), tiles};
  }
  torch::Tensor sum;
  std::vector<std::pair<const TileSpan*, const TileSpan*>> places;
  std::vector<torch::Tensor> waiting;
  const auto flush = [&] {
    if (waiting.empty()) return;
    const auto results = network(waiting.size() == 1 ? waiting.front() : torch::cat(waiting, 0))
                             .to(torch::kCPU, torch::kFloat);
    const std::int64_t upscale = results.size(2) / waiting.front().size(2);
    for (std::size_t i = 0; i < places.size(); ++i) {
      const auto& [r, c] = places[i];
      if (!sum.defined())
        sum = torch::zeros({1, results.size(1), tiling.rows * upscale, tiling.cols * upscale});
      const auto weight = torch::tensor(r->weight).repeat_interleave(upscale).view({-1, 1}) *
                          torch::tensor(c->weight).repeat_interleave(upscale);
      sum.slice(2, r->begin * upscale, r->end * upscale)
          .slice(3, c->begin * upscale, c->end * upscale)
          .add_(results.slice(0, static_cast<std::int64_t>(i), static_cast<std::int64_t>(i) + 1) *
                weight);
    }
    progress.advance(static_cast<std::int64_t>(places.size()));
    places.clear();
    waiting.clear();
  };
  for (const TileSpan& r : down)
    for (const TileSpan& c : across) {
      check_stop(progress);
      auto tile = input(r, c);
      if (!waiting.empty() &&
          (std::ssize(waiting) >= tiling.batch || tile.sizes() != waiting.front().sizes()))
        flush();
      waiting.push_back(std::move(tile));
      places.emplace_back(&r, &c);
    }
  flush();
  return {std::move(sum), tiles};
}

}  // namespace malus
