#include "malus/neural/network.h"

#include "malus/base/error.h"
#include "malus/neural/internal/network_size.h"
#include "malus/neural/loss.h"

#include <algorithm>

#include "problem_of.h"
#include "small_networks.h"
#include "support.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

// Outputs of the public PyTorch implementations with random weights: ours agree to 1e-4.
class Parity : public ::testing::TestWithParam<const char*> {};

TEST_P(Parity, MatchesThePublicImplementation) {
  const auto path = testing::shared_data() / "parity" / (std::string(GetParam()) + ".safetensors");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << "needs ../shared/data/parity";
  auto file = load_tensor_file(path);
  const auto name = file.metadata.at("network");
  const NetworkDescription description{name.substr(0, name.find('_')),
                                       nlohmann::json::parse(file.metadata.at("settings"))};
  const auto network = make_network(description);
  EXPECT_EQ(std::to_string(parameter_count(*network)), file.metadata.at("parameters"));
  load_weights(*network, file, "weights.", path.string());
  network->eval();
  const torch::NoGradGuard no_gradients;
  const auto output = network->forward(to_torch(file.tensors.at("input")));
  const auto expected = to_torch(file.tensors.at("output"));
  ASSERT_EQ(output.sizes(), expected.sizes());
  EXPECT_LT((output - expected).abs().max().item<double>(), 1e-4);
}

INSTANTIATE_TEST_SUITE_P(Networks, Parity,
                         ::testing::Values("nafnet", "restormer_biasfree", "uformer"));

TEST(Networks, EveryOneTakesAnySizeAndKeepsIt) {
  const torch::NoGradGuard no_gradients;
  for (const auto& name : network_names()) {
    const auto network = make_network(testing::small_network(name));
    for (const auto& [rows, cols] : {std::pair{1, 1}, {17, 40}, {64, 33}}) {
      const auto y = network->forward(torch::rand({2, 4, rows, cols}));
      EXPECT_EQ(y.sizes(), torch::IntArrayRef({2, 4, rows, cols})) << name;
      EXPECT_TRUE(torch::isfinite(y).all().item<bool>()) << name;
    }
  }
}

TEST(Networks, WeightsSurviveTheFile) {
  const testing::TemporaryFolder folder;
  for (const auto& name : network_names()) {
    const auto description = testing::small_network(name);
    const auto one = make_network(description), other = make_network(description);
    save_tensor_file(weights_of(*one, description), folder / "w.safetensors");
    const auto file = load_tensor_file(folder / "w.safetensors");
    EXPECT_EQ(file.metadata.at("architecture"), name);
    load_weights(*other, file, "", "w.safetensors");
    const torch::NoGradGuard no_gradients;
    const auto x = torch::rand({1, 4, 32, 32});
    EXPECT_TRUE(torch::equal(one->forward(x), other->forward(x))) << name;
  }
}

// One random direction through all parameters at once: the slope is the sum of gradient times
// direction.
TEST(Networks, GradientsAgreeWithFiniteDifferences) {
  for (const auto& name : network_names()) {
    torch::manual_seed(3);
    const auto network = make_network(testing::small_network(name));
    network->to(torch::kDouble);
    const auto x = torch::rand({1, 4, 16, 16}, torch::kDouble);
    const auto weight = torch::randn({1, 4, 16, 16}, torch::kDouble);
    const auto value = [&] { return (network->forward(x) * weight).sum(); };
    value().backward();
    const torch::NoGradGuard no_gradients;
    const auto parameters = network->parameters();
    std::vector<torch::Tensor> direction;
    double slope = 0;
    for (const auto& parameter : parameters) {
      ASSERT_TRUE(parameter.grad().defined()) << name << " has a parameter that nothing uses";
      direction.push_back(torch::randn_like(parameter));
      slope += (parameter.grad() * direction.back()).sum().item<double>();
    }
    const auto move = [&](double step) {
      for (std::size_t i = 0; i < parameters.size(); ++i)
        torch::Tensor(parameters[i]).add_(direction[i], step);
      return value().item<double>();
    };
    constexpr double kStep = 1e-6;
    const double up = move(kStep), down = move(-2 * kStep);
    EXPECT_NEAR((up - down) / (2 * kStep), slope, 1e-4 * (1 + std::abs(slope))) << name;
  }
}

TEST(Networks, CountsOfValuesAreWrittenOut) {
  const auto told = [](const auto& make) -> std::string {
    try {
      make();
    } catch (const InputError& error) {
      return error.what();
    }
    return "nothing";
  };
  TensorFile few;
  few.tensors["x"] = from_torch(torch::zeros({1234}));
  const std::string too_few = told([&] {
    make_network({"unet", {{"width", 4}}}, few, "w.safetensors");
  });
  EXPECT_NE(too_few.find("holds 1,234 values"), std::string::npos) << too_few;
  EXPECT_EQ(too_few.find("e+"), std::string::npos) << too_few;
  const std::string many = told([] { make_network({"unet", {{"width", 4096}}}); });
  EXPECT_NE(many.find(" million values, more than 537 million"), std::string::npos) << many;
}

TEST(Networks, UnknownNamesAndSettingsAreRefused) {
  EXPECT_THROW(make_network({"restorner", {}}), InputError);
  EXPECT_THROW(make_network({"unet", {{"widht", 4}}}), InputError);
  EXPECT_THROW(make_network({"unet", {{"width", "four"}}}), InputError);
}

// As in the public implementations a stage without blocks returns what it is given.
TEST(Networks, StagesMayHaveNoBlocks) {
  torch::manual_seed(1);
  for (const auto& [name, change] : std::vector<std::pair<std::string, nlohmann::json>>{
           {"nafnet", {{"enc_blk_nums", {0, 1}}, {"dec_blk_nums", {1, 0}}, {"width", 16}}},
           {"restormer", {{"num_refinement_blocks", 0}}}}) {
    NetworkDescription description = testing::small_network(name);
    description.settings.update(change);
    const auto network = make_network(description);
    const auto x = torch::rand({1, 4, 24, 16});
    const auto with_gradients = network->forward(x);  // the layers', not the kernels'
    EXPECT_EQ(with_gradients.sizes(), x.sizes()) << name;
    const torch::NoGradGuard no_gradients;
    EXPECT_TRUE(torch::allclose(network->forward(x), with_gradients, 1e-4, 1e-5)) << name;
  }
}

// A digit too many must not take the machine's memory: nothing is built.
TEST(Networks, SettingsOutOfRangeAreRefused) {
  const std::vector<NetworkDescription> wrong = {
      {"unet", {{"levels", 100}}},
      {"unet", {{"levels", 0}}},
      {"unet", {{"width", -1}}},
      {"unet", {{"width", 4.5}}},
      {"unet", {{"width", 1e300}}},
      {"unet", {{"width", 4096}, {"levels", 8}}},
      {"unet", {{"upscale", 1000}}},
      {"unet", {{"in_channels", 1 << 20}}},
      {"nafnet", {{"middle_blk_num", 1000000}}},
      {"nafnet", {{"enc_blk_nums", std::vector<int>(40, 1)}, {"dec_blk_nums", {1}}}},
      {"nafnet", {{"enc_blk_nums", {1, 1}}, {"dec_blk_nums", {1}}}},
      {"nafnet", {{"enc_blk_nums", {"one"}}, {"dec_blk_nums", {1}}}},
      {"restormer", {{"dim", 4096}}},
      {"restormer", {{"num_blocks", {1, 1}}}},
      {"restormer", {{"heads", {0, 1, 1, 1}}}},
      {"restormer", {{"heads", {5, 5, 5, 5}}}},
      {"restormer", {{"ffn_expansion_factor", 1e9}}},
      {"restormer", {{"LayerNorm_type", "None"}}},
      {"uformer", {{"depths", {1, 1, 1}}}},
      {"uformer", {{"depths", std::vector<int>(9, 1 << 30)}}},
      {"uformer", {{"win_size", 1 << 20}}},
      {"uformer", {{"embed_dim", 4096}}},
      {"uformer", {{"token_projection", "conv"}}},
      {"uformer", {{"token_mlp", "mlp"}}},
      {"malus", {{"dim", 64}, {"depths", std::vector<int>(60, 2)}}},
      {"malus", {{"depths", {1, 1, 1}}}},
      {"malus", {{"window", 0}}},
  };
  for (const NetworkDescription& description : wrong) {
    EXPECT_THROW(make_network(description), InputError)
        << description.architecture << ' ' << description.settings.dump();
  }
}

TEST(Networks, LeastValuesAreBelowTheTrueOnesAndNearThem) {
  for (const auto& name : network_names())
    for (const nlohmann::json& settings :
         {nlohmann::json::object(), testing::small_network(name).settings}) {
      const NetworkDescription description{name, settings};
      const auto network = make_network(description);
      double values = 0;
      for (const auto& parameter : network->parameters())
        values += static_cast<double>(parameter.numel());
      for (const auto& buffer : network->buffers()) values += static_cast<double>(buffer.numel());
      const double least = least_network_values(name, full_settings(description));
      EXPECT_LE(least, values) << name;
      EXPECT_GE(least, 0.2 * values) << name;
    }
}

TEST(Weights, TooFewForTheSettingsAreRefusedBeforeBuilding) {
  const NetworkDescription described = testing::small_network("unet");
  const TensorFile file = weights_of(*make_network(described), described);
  EXPECT_NO_THROW(make_network(described, file, "f"));
  for (const nlohmann::json& change : {nlohmann::json{{"levels", 8}}, {{"levels", 40}}}) {
    NetworkDescription edited = described;
    edited.settings.update(change);
    try {
      make_network(edited, file, "edited.safetensors");
      FAIL() << change.dump();
    } catch (const InputError& error) {
      EXPECT_EQ(error.subject(), "edited.safetensors");
    }
  }
}

TEST(Weights, OfAnotherNetworkAreRefused) {
  const auto network = make_network(testing::small_network("unet"));
  auto file = weights_of(*network, testing::small_network("unet"));
  auto missing = file;
  missing.tensors.erase("conv1_1.weight");
  EXPECT_THROW(load_weights(*network, missing, "", "f"), InputError);
  auto extra = file;
  extra.tensors["stranger"] = file.tensors.at("conv1_1.bias");
  EXPECT_THROW(load_weights(*network, extra, "", "f"), InputError);
}

// What a network builds of its settings: by another index it would look up other weights.
TEST(Weights, BuffersThatAreNotTheNetworksOwnAreRefused) {
  for (const char* name : {"malus", "uformer"}) {
    const NetworkDescription description = testing::small_network(name);
    TensorFile file = weights_of(*make_network(description), description);
    EXPECT_NO_THROW(make_network(description, file, "f"));
    const auto buffer = std::ranges::find_if(file.tensors, [](const auto& item) {
      return item.first.ends_with("relative_position_index");
    });
    ASSERT_NE(buffer, file.tensors.end()) << name;
    torch::Tensor index = to_torch(buffer->second);
    index.view(-1)[3] += 1;
    buffer->second = from_torch(index);
    const std::string line = testing::problem_of([&] { make_network(description, file, "f"); });
    EXPECT_TRUE(line.starts_with("f: ")) << line;
    EXPECT_NE(line.find(buffer->first), std::string::npos) << line;
  }
}

// One pixel that differs by d in I0 alone changes S0 by d/2 and S1 by d: the mean over 3 Stokes
// values is d/2.
TEST(StokesLoss, MatchesItsClosedForm) {
  const auto layout = SensorLayout::named("polar-mono");
  const auto target = torch::rand({1, 4, 1, 1}, torch::kDouble);
  auto output = target.clone();
  output.select(1, layout.find(Color::kMono, 0)) += 0.3;
  EXPECT_NEAR(stokes_loss(output, target, layout).item<double>(), (0.15 + 0.3) / 3, 1e-12);
  EXPECT_NEAR(l1_distance(output, target).item<double>(), 0.3 / 4, 1e-12);
}

// One of four angles is not known: three of four values remain for L1, and of three Stokes
// parameters S2 alone. What is left out adds nothing to a mean over all of them.
TEST(Losses, LeaveOutWhatTheTargetDoesNotTell) {
  const auto layout = SensorLayout::named("polar-mono");
  auto target = torch::rand({1, 4, 1, 1}, torch::kDouble);
  auto output = (target + 0.1).detach();
  output.select(1, layout.find(Color::kMono, 0)) += 5;
  output.select(1, layout.find(Color::kMono, 45)) += 0.3;
  output.requires_grad_();
  target.select(1, layout.find(Color::kMono, 0)).fill_(std::nan(""));
  const auto l1 = l1_distance(output, target), stokes = stokes_loss(output, target, layout);
  EXPECT_NEAR(l1.item<double>(), 0.6 / 4, 1e-12);
  EXPECT_NEAR(stokes.item<double>(), 0.3 / 3, 1e-12);
  (l1 + stokes).backward();
  const auto gradient_of = [&](int angle) {
    return output.grad().select(1, layout.find(Color::kMono, angle)).item<double>();
  };
  EXPECT_EQ(gradient_of(0), 0);
  EXPECT_NEAR(gradient_of(45), 1.0 / 4 + 1.0 / 3, 1e-12);
  EXPECT_NEAR(gradient_of(90), 1.0 / 4, 1e-12);
  EXPECT_NEAR(gradient_of(135), 1.0 / 4 - 1.0 / 3, 1e-12);
  const auto nothing = l1_distance(output, torch::full_like(target, std::nan("")));
  EXPECT_EQ(nothing.item<double>(), 0);
}

// Workers share a batch, whose patches are not known alike: the mean of theirs is the whole's.
TEST(Losses, OfPartsHaveTheMeanOfTheWhole) {
  const auto layout = SensorLayout::named("polar-mono");
  const auto output = torch::rand({4, 4, 3, 5}), target = torch::rand({4, 4, 3, 5});
  const float whole = l1_distance(output, target).item<float>();
  EXPECT_EQ(whole, ((output - target).abs().sum() / target.numel()).item<float>());
  target[0].slice(2, 0, 3).fill_(std::nan(""));
  target[3][1].fill_(std::nan(""));
  TrainSettings settings;
  for (const char* loss : {"l1", "stokes", "l1+stokes"}) {
    settings.loss = loss;
    const auto of = [&](int begin, int end) {
      return training_loss(settings, layout, output.slice(0, begin, end),
                           target.slice(0, begin, end))
          .item<double>();
    };
    EXPECT_NEAR((of(0, 2) + of(2, 4)) / 2, of(0, 4), 1e-7) << loss;
  }
}

}  // namespace
}  // namespace malus
