#include "malus/neural/measure.h"

#include "malus/neural/network.h"

#include <map>

#include <gtest/gtest.h>

namespace malus {
namespace {

// One convolution and one product, counted by hand: a U-Net of one level.
TEST(Measure, CountsMultiplicationsOfConvolutions) {
  const NamedNetwork tiny{
      "tiny", "unet", {{"in_channels", 3}, {"out_channels", 5}, {"width", 4}, {"levels", 1}}};
  const NetworkCost cost = measure_network(tiny, 3, 10, 12, 0);
  EXPECT_EQ(cost.multiply_adds, 10 * 12 * (9 * 3 * 4 + 9 * 4 * 4 + 4 * 5));
  EXPECT_EQ(cost.parameters, 9 * 3 * 4 + 4 + 9 * 4 * 4 + 4 + 4 * 5 + 5);
}

// The public implementations' counts with 16 channels, and our own sizes as docs/networks.md says.
TEST(Measure, ParameterCountsAreThoseOfTheDocumentation) {
  const std::map<std::string, double> millions = {{"unet", 7.8},       {"nafnet-32", 29.2},
                                                  {"uformer-t", 5.3},  {"uformer-s", 20.7},
                                                  {"uformer-b", 51.0}, {"restormer", 26.2}};
  std::size_t known = 0;
  for (const NamedNetwork& named : named_networks()) {
    const auto found = millions.find(named.name);
    if (found == millions.end()) continue;
    ++known;
    const auto network = make_network({named.architecture, named.settings});
    EXPECT_NEAR(static_cast<double>(parameter_count(*network)) / 1e6, found->second,
                0.02 * found->second)
        << named.name;
  }
  EXPECT_EQ(known, millions.size());
}

// The head of 001, S4 and S6: four Bayer planes in, a picture of the mosaic's size out.
TEST(UNet, HeadGivesRgbOfTheMosaicsSize) {
  const torch::NoGradGuard no_gradients;
  const NetworkDescription description{
      "unet", {{"in_channels", 4}, {"out_channels", 3}, {"width", 4}, {"upscale", 2}}};
  const auto network = make_network(description);
  for (const auto& [rows, cols] : {std::pair{16, 32}, {17, 5}}) {
    const auto rgb = network->forward(torch::rand({2, 4, rows, cols}));
    EXPECT_EQ(rgb.sizes(), torch::IntArrayRef({2, 3, 2 * rows, 2 * cols}));
  }
}

// Pixel shuffle puts output plane k of a colour at row k / 2, column k % 2 of its pixel pair: with
// a head that passes constants each Bayer site keeps its place.
TEST(UNet, HeadsPlanesLieAtTheMosaicsSites) {
  const torch::NoGradGuard no_gradients;
  const auto network = make_network(
      {"unet", {{"in_channels", 4}, {"out_channels", 3}, {"width", 4}, {"upscale", 2}}});
  for (const auto& item : network->named_parameters()) torch::Tensor(item.value()).zero_();
  auto bias = network->named_parameters()["conv10_1.bias"];
  bias.copy_(torch::arange(12, torch::kFloat));
  const auto rgb = network->forward(torch::rand({1, 4, 16, 16}));
  for (std::int64_t colour = 0; colour < 3; ++colour)
    for (std::int64_t site = 0; site < 4; ++site)
      EXPECT_EQ(rgb[0][colour][4 + site / 2][6 + site % 2].item().toDouble(),
                static_cast<double>(4 * colour + site));
}

}  // namespace
}  // namespace malus
