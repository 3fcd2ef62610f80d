#include "malus/neural/internal/tiles.h"

#include <algorithm>

#include <gtest/gtest.h>

namespace malus {
namespace {

NetworkDescription small_unet() {
  return {"unet", {{"in_channels", 2}, {"out_channels", 2}, {"width", 4}}};
}

// Of cores smaller than the overlap too, whose ramps would meet.
TEST(TileSpans, WeightsSumToOneEverywhere) {
  for (const bool exact : {true, false})
    for (const std::int64_t core : {8, 24, 64}) {
      const TileDemand demand{.multiple = 8, .overlap = 32, .exact = exact, .bytes_per_pixel = 1};
      for (const std::int64_t length : {5, 64, 129, 200}) {
        std::vector<double> sum(static_cast<std::size_t>(length));
        std::int64_t covered = 0;
        for (const TileSpan& span : tile_spans(length, core, demand)) {
          ASSERT_EQ(std::ssize(span.weight), span.end - span.begin);
          EXPECT_EQ(span.begin % demand.multiple, 0);
          EXPECT_EQ(span.core_begin, covered);
          covered = span.core_end;
          for (std::int64_t at = span.begin; at < span.end; ++at)
            sum[static_cast<std::size_t>(at)] +=
                static_cast<double>(span.weight[static_cast<std::size_t>(at - span.begin)]);
        }
        EXPECT_EQ(covered, length);
        const auto [least, most] = std::minmax_element(sum.begin(), sum.end());
        EXPECT_NEAR(*least, 1, 1e-6) << length << ' ' << core;
        EXPECT_NEAR(*most, 1, 1e-6) << length << ' ' << core;
      }
    }
}

TEST(RunTiled, ConstantsStayConstantForAnyCore) {
  const TileDemand demand{.multiple = 8, .overlap = 32, .exact = false, .bytes_per_pixel = 1};
  const auto x = torch::full({1, 1, 70, 90}, 0.7);
  for (const std::int64_t side : {8, 16, 40}) {
    const auto result = run_tiled(
        {70, 90, {side, side}, 1, demand},
        [&](const TileSpan& r, const TileSpan& c) {
          return x.slice(2, r.begin, r.end).slice(3, c.begin, c.end);
        },
        [](const torch::Tensor& tile) { return tile; }, silent_progress());
    EXPECT_LT((result.planes - x).abs().max().item<double>(), 1e-5) << side;
  }
}

TEST(TileCore, IsTheWholePictureWhereItFitsAndStaysWithinTheBytes) {
  const TileDemand demand{.multiple = 16, .overlap = 32, .exact = true, .bytes_per_pixel = 100};
  const TileCore whole = tile_core(300, 200, 304 * 208 * 100, 1, demand);
  EXPECT_EQ(whole.rows, 300);
  EXPECT_EQ(whole.cols, 200);
  for (const int batch : {1, 2}) {
    const TileCore core = tile_core(3000, 2000, 200 * 200 * 100, batch, demand);
    EXPECT_EQ(core.rows % 16, 0);
    EXPECT_EQ(core.cols % 16, 0);
    EXPECT_GT(core.rows, 0);
    EXPECT_LE(batch * (core.rows + 64) * (core.cols + 64) * 100, 200 * 200 * 100);
  }
  // A narrow picture is cut along one direction only.
  EXPECT_EQ(tile_core(3000, 100, 300 * 112 * 100, 1, demand).cols, 100);
}

// 129 pixels become 256 in the network, whole or as the side of a tile.
TEST(TileCore, CountsThePixelsThatNetworksPadTo) {
  const TileDemand demand{.multiple = 128, .overlap = 128, .exact = false, .bytes_per_pixel = 100};
  EXPECT_EQ(tile_core(129, 129, 129 * 129 * 100, 1, demand).rows, 0);
  EXPECT_EQ(tile_core(129, 129, 256 * 256 * 100, 1, demand).rows, 129);
  EXPECT_EQ(tile_core(129, 5000, 140 * 384 * 100, 1, demand).rows, 0);
  const TileCore low = tile_core(129, 5000, 256 * 384 * 100, 1, demand);
  EXPECT_EQ(low.rows, 129);
  EXPECT_EQ(low.cols, 128);
}

// Rows that a frame does not have need no memory, and what is said to suffice does.
TEST(TileCore, TakesTheLeastBytesThatItStates) {
  const TileDemand demand{.multiple = 16, .overlap = 64, .exact = false, .bytes_per_pixel = 100};
  EXPECT_EQ(tile_core(100, 4000, 112 * 144 * 100, 1, demand).rows, 100);
  EXPECT_EQ(least_tile_bytes(100, 4000, 1, demand), 112 * 144 * 100);
  EXPECT_EQ(least_tile_bytes(40, 60, 8, demand), 48 * 64 * 100);  // one tile, whatever the batch
  for (const std::int64_t rows : {8, 100, 300, 3000})
    for (const std::int64_t cols : {8, 100, 300, 2000})
      for (const int batch : {1, 3}) {
        const double least = least_tile_bytes(rows, cols, batch, demand);
        EXPECT_GT(tile_core(rows, cols, least, batch, demand).rows, 0) << rows << ' ' << cols;
        EXPECT_EQ(tile_core(rows, cols, least - 100, batch, demand).rows, 0) << rows << ' ' << cols;
      }
}

// The reach of one output value, from the gradient: nothing beyond the stated overlap.
TEST(TileDemand, TheUNetReachesNoFurtherThanItsOverlap) {
  const TileDemand demand = tile_demand(small_unet(), true);
  ASSERT_TRUE(demand.exact);
  const auto network = make_network(small_unet());
  network->to(torch::kDouble);
  constexpr std::int64_t kSize = 288, kEdge = 144;
  auto input = torch::rand({1, 2, kSize, kSize}, torch::kDouble).requires_grad_(true);
  // One core's corner at a multiple of 16: its upper and left neighbours are the tightest.
  network->forward(input).slice(2, kEdge, kEdge + 16).slice(3, kEdge, kEdge + 16).sum().backward();
  const auto touched = input.grad().abs().amax({0, 1}) > 0;
  const auto rows = torch::any(touched, 1).nonzero().squeeze(1);
  const auto first = rows.min().item().toLong(), last = rows.max().item().toLong();
  EXPECT_GE(first, kEdge - demand.overlap);
  EXPECT_LT(last, kEdge + 16 + demand.overlap);
  EXPECT_LT(first, kEdge - demand.overlap / 2) << "an overlap twice as large as needed";
}

torch::Tensor tiled(const NetworkDescription& description, Network& network, const torch::Tensor& x,
                    std::int64_t side, int batch) {
  return run_tiled(
             {x.size(2), x.size(3), {side, side}, batch, tile_demand(description, true)},
             [&](const TileSpan& r, const TileSpan& c) {
               return x.slice(2, r.begin, r.end).slice(3, c.begin, c.end);
             },
             [&](const torch::Tensor& input) { return network.forward(input); }, silent_progress())
      .planes;
}

TEST(RunTiled, EqualsTheWholeForTheUNet) {
  const torch::NoGradGuard no_gradients;
  torch::manual_seed(1);
  const auto network = make_network(small_unet());
  const auto x = torch::rand({1, 2, 301, 270});
  const auto whole = network->forward(x);
  for (const int batch : {1, 3}) {
    const auto parts = tiled(small_unet(), *network, x, 64, batch);
    EXPECT_LT((parts - whole).abs().max().item<double>(), 1e-5);
  }
}

// Odd widths of transformers are left to libtorch's layers, which need more memory and round
// nothing; unet's and nafnet's kernels take any.
TEST(TileDemand, KernelsTakeWholeVectorsOnACpu) {
  const auto demand = [](const char* architecture, const char* width, int value, bool on_cpu) {
    return tile_demand({architecture, {{width, value}}}, on_cpu);
  };
  EXPECT_TRUE(demand("nafnet", "width", 48, true).own_kernels);
  EXPECT_FALSE(demand("nafnet", "width", 48, false).own_kernels);
  EXPECT_TRUE(demand("nafnet", "width", 40, true).own_kernels);
  EXPECT_TRUE(demand("unet", "width", 40, true).own_kernels);
  EXPECT_TRUE(demand("malus", "dim", 32, true).own_kernels);
  EXPECT_FALSE(demand("uformer", "embed_dim", 24, true).own_kernels);
  EXPECT_GT(demand("nafnet", "width", 40, false).bytes_per_pixel,
            demand("nafnet", "width", 48, true).bytes_per_pixel);
  EXPECT_EQ(demand("nafnet", "width", 40, true).bytes_per_pixel,
            demand("nafnet", "width", 48, true).bytes_per_pixel);
}

// The others reach everywhere: their tiles fade into each other, so no step is larger at a seam
// than inside.
TEST(RunTiled, LeavesNoSeamWhereTilesCannotBeExact) {
  const torch::NoGradGuard no_gradients;
  torch::manual_seed(2);
  const NetworkDescription description{"nafnet",
                                       {{"img_channel", 2},
                                        {"width", 8},
                                        {"middle_blk_num", 1},
                                        {"enc_blk_nums", {1, 1}},
                                        {"dec_blk_nums", {1, 1}}}};
  EXPECT_FALSE(tile_demand(description, true).exact);
  const auto network = make_network(description);
  for (const auto& parameter : network->named_parameters())
    if (parameter.key().ends_with("beta") || parameter.key().ends_with("gamma"))
      torch::Tensor(parameter.value()).fill_(0.2);
  // A ramp: the tiles' means, and with them their channel weights, differ.
  const auto x =
      torch::linspace(0, 1, 256).view({1, 1, 1, 256}).expand({1, 2, 64, 256}).contiguous();
  const auto y = tiled(description, *network, x, 64, 1);
  const auto step = (y.slice(3, 1) - y.slice(3, 0, 255)).abs().amax({0, 1, 2});
  const double inside = step.slice(0, 20, 40).max().item<double>();
  EXPECT_LT(step.slice(0, 8, 247).max().item<double>(), 3 * inside + 1e-4);
}

}  // namespace
}  // namespace malus
