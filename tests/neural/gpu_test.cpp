// A GPU gives what the CPU gives. Skipped where libtorch finds none; the placing of weights and the
// measurement are tried on the CPU.
#include "malus/neural/gpu.h"

#include "malus/base/error.h"
#include "malus/neural/device_speed.h"
#include "malus/neural/inference.h"
#include "malus/neural/internal/recorded_pass.h"
#include "malus/neural/loss.h"
#include "malus/neural/trainer.h"
#include "malus/noise/model.h"
#include "malus/synthesize/synthesizer.h"

#include "small_networks.h"
#include "support.h"
#include "training_runs.h"
#include <ATen/Context.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::TemporaryFolder;

#define MALUS_NEEDS_GPU() \
  if (!torch::cuda::is_available()) GTEST_SKIP() << "needs a GPU that libtorch finds"

// float32 with all of its bits, for a while.
class WithoutTf32 {
 public:
  WithoutTf32() { set(false, false); }
  ~WithoutTf32() { set(convolutions_, products_); }
  WithoutTf32(const WithoutTf32&) = delete;
  WithoutTf32& operator=(const WithoutTf32&) = delete;

 private:
  static void set(bool convolutions, bool products) {
    at::globalContext().setAllowTF32CuDNN(convolutions);
    at::globalContext().setAllowTF32CuBLAS(products);
  }
  bool convolutions_ = at::globalContext().allowTF32CuDNN(),
       products_ = at::globalContext().allowTF32CuBLAS();
};

// No branch counts nothing: nafnet's begin at zero.
void scatter_weights(Network& network) {
  const torch::NoGradGuard no_gradients;
  for (torch::Tensor& parameter : network.parameters())
    parameter.add_(0.1 * torch::randn_like(parameter));
}

double largest_difference(const torch::Tensor& a, const torch::Tensor& b) {
  return ((a - b).abs().max() / a.abs().max()).item<double>();
}

// With gradients both run libtorch's layers, without the CPU may take kernels of its own.
void expect_the_cpus_output(const torch::Device& device) {
  for (const auto& name : network_names())
    for (const bool channels_last : {false, true}) {
      torch::manual_seed(6);
      const auto description = testing::small_network(name);
      const auto here = make_network(description), there = make_network(description);
      scatter_weights(*here);
      load_weights(*there, weights_of(*here, description), "", name);
      place_network(*there, device, channels_last);
      const auto input = torch::randn({2, 4, 40, 33});
      const auto expected = here->forward(input);
      const auto output = there->forward(placed(input, device, channels_last));
      ASSERT_EQ(output.device().type(), device.type());
      EXPECT_LT(largest_difference(expected, output.to(torch::kCPU)), 1e-3) << name;
      // One step down the same slope.
      expected.square().mean().backward();
      output.square().mean().backward();
      const auto ours = here->parameters(), theirs = there->parameters();
      for (std::size_t i = 0; i < ours.size(); ++i)
        EXPECT_LT((ours[i].grad() - theirs[i].grad().to(torch::kCPU)).norm().item<double>(),
                  1e-3 * ours[i].grad().norm().item<double>() + 1e-6)
            << name << " " << i;
      const torch::NoGradGuard no_gradients;
      EXPECT_LT(
          largest_difference(here->forward(input),
                             there->forward(placed(input, device, channels_last)).to(torch::kCPU)),
          1e-3)
          << name;
    }
}

TEST(Gpu, NetworksGiveWhatTheyGiveOnTheCpu) {
  MALUS_NEEDS_GPU();
  const WithoutTf32 exact;
  expect_the_cpus_output(torch::kCUDA);
}

TEST(ChannelsLast, ChangesNoOutput) { expect_the_cpus_output(torch::kCPU); }

// A frame in tiles: of unet, whose tiles are exact, and of malus, which takes no kernels of this
// width on a CPU, so that both devices cut the same ones. nafnet's kernels want others: it gets the
// frame in one piece.
TEST(Gpu, TiledInferenceGivesWhatTheCpuGives) {
  MALUS_NEEDS_GPU();
  const WithoutTf32 exact;
  const TemporaryFolder folder;
  const NoiseModel model = load_model("imx250mzr-simulated");
  const GainSetting gain{12.0, {}};
  Image clean_dn(600, 500);
  for (int r = 0; r < clean_dn.rows(); ++r)
    for (int c = 0; c < clean_dn.cols(); ++c)
      clean_dn(r, c) = static_cast<float>(300 + 200 * std::sin(0.03 * r) * std::cos(0.02 * c));
  const RawFrame noisy = Synthesizer(model, SynthesisSettings())
                             .draw_raw(clean_dn, gain, {.seed = 1}, model.black_dn, model.white_dn);
  struct Case {
    NetworkDescription network;
    double memory_mib;
    bool in_tiles;
  };
  for (const auto& [network, memory_mib, in_tiles] : std::vector<Case>{
           {{"unet", {{"width", 16}, {"levels", 3}}}, 40, true},
           {{"nafnet",
             {{"width", 8}, {"middle_blk_num", 1}, {"enc_blk_nums", {1}}, {"dec_blk_nums", {1}}}},
            1024,
            false},
           {{"malus", {{"dim", 8}, {"depths", {2, 1}}, {"heads", {1, 1}}}}, 40, true}}) {
    torch::manual_seed(8);
    NetworkPackage package;
    package.settings.layout = "polar-mono";
    package.network = fitted_network(network, package.settings);
    const auto built = make_network(package.network);
    scatter_weights(*built);
    save_tensor_file(package_file(package, *built), folder / "w.safetensors");
    DenoiseSettings settings;
    settings.memory_mib = memory_mib;
    const auto denoised = [&](const std::string& device) {
      NetworkInference inference(folder / "w.safetensors",
                                 {.device = device, .tile_batch = 2, .ratio = {}});
      return inference.denoise(noisy, model.profile_at(gain), settings, silent_progress());
    };
    const Denoised here = denoised("cpu"), there = denoised("cuda");
    EXPECT_EQ(there.tiles > 1, in_tiles) << network.architecture;
    double difference = 0;
    for (int r = 0; r < clean_dn.rows(); ++r)
      for (int c = 0; c < clean_dn.cols(); ++c)
        difference =
            std::max(difference, std::abs(static_cast<double>(here.dn_above_black(r, c)) -
                                          static_cast<double>(there.dn_above_black(r, c))));
    EXPECT_LT(difference, 0.5) << network.architecture;  // DN, of noise of some ten
  }
}

TrainingConfig short_run(const testing::AngleScene& scene, const std::string& device,
                         const std::string& precision) {
  TrainingConfig config = testing::scene_config(scene);
  // From random outputs, so that a few steps show.
  config.package.settings.residual = false;
  config.package.network =
      fitted_network({"unet", {{"width", 8}, {"levels", 2}}}, config.package.settings);
  config.train.device = device;
  config.train.precision = precision;
  config.train.steps = 24;
  config.train.learning_rate = 3e-3;
  return config;
}

void expect_training_goes_down_and_on(const std::string& device, const std::string& precision) {
  const TemporaryFolder folder;
  const testing::AngleScene scene(folder);
  const TrainingConfig config = short_run(scene, device, precision);
  const auto worker = single_worker();
  const auto once = train(config, {folder / "once", false, false, 3}, *worker, silent_progress());
  ASSERT_EQ(once["log"].size(), 24u);
  const auto loss = [](const auto& run, std::size_t step) {
    return run["log"][step]["loss"].template get<double>();
  };
  EXPECT_LT(loss(once, 23), 0.6 * loss(once, 0)) << precision;
  testing::StopAfter stop(10);
  EXPECT_THROW(train(config, {folder / "parts", false, false, 3}, *worker, stop), Cancelled);
  const auto parts = train(config, {folder / "parts", true, false, 3}, *worker, silent_progress());
  ASSERT_EQ(parts["log"].size(), 24u);
  // On a GPU the order of sums may change from run to run.
  const double step = precision == "float32" ? 0.01 : 0.05;
  EXPECT_NEAR(loss(parts, 23), loss(once, 23), step * loss(once, 0)) << precision;
}

TEST(Gpu, TrainingGoesDownAndResumes) {
  MALUS_NEEDS_GPU();
  for (const char* precision : {"float32", "bfloat16"})
    expect_training_goes_down_and_on("cuda", precision);
}

// Passes of one network, recorded or not, while its weights change between them.
std::vector<torch::Tensor> losses_and_gradients(const std::string& name,
                                                const torch::Device& device, bool recorded) {
  torch::manual_seed(8);
  const auto network = make_network(testing::small_network(name));
  scatter_weights(*network);
  place_network(*network, device, kChannelsLast);
  const auto parameters = network->parameters();
  RecordedPass pass(
      parameters,
      [&](const TrainingExample& batch) -> StepLosses {
        return {l1_distance(network->forward(batch.input), batch.target),
                l1_distance(batch.input, batch.target)};
      },
      recorded);
  std::vector<torch::Tensor> told;
  for (int step = 0; step < RecordedPass::kLaunchedFirst + 3; ++step) {
    const auto input = torch::rand({2, 4, 24, 32}), target = torch::rand({2, 4, 24, 32});
    const StepLosses losses = pass({input.to(device), target.to(device)});
    told.push_back(losses.loss.clone());
    told.push_back(losses.base_loss.clone());
    const torch::NoGradGuard no_gradients;
    std::vector<torch::Tensor> gradients;
    for (const torch::Tensor& parameter : parameters) {
      gradients.push_back(parameter.grad().flatten());
      parameter.sub_(parameter.grad(), 0.01);
    }
    told.push_back(torch::cat(gradients));
  }
  EXPECT_EQ(pass.refusal(), "") << name;
  return told;
}

TEST(RecordedPass, GivesTheGradientsOfItsBatchAlone) {
  const auto weight = torch::ones({1}, torch::requires_grad());
  const auto unused = torch::ones({1}, torch::requires_grad());
  RecordedPass pass(
      {weight, unused},
      [&](const TrainingExample& batch) -> StepLosses {
        return {(weight * batch.input - batch.target).square().mean(), batch.target.mean()};
      },
      true);
  for (const float x : {1.0F, 2.0F, 3.0F, 4.0F, 5.0F}) {
    const StepLosses losses = pass({torch::full({1}, x), torch::full({1}, 0.5F)});
    EXPECT_FLOAT_EQ(losses.loss.item<float>(), (x - 0.5F) * (x - 0.5F));
    EXPECT_FALSE(losses.loss.requires_grad());
    EXPECT_FLOAT_EQ(losses.base_loss.item<float>(), 0.5F);
    EXPECT_FLOAT_EQ(weight.grad().item<float>(), 2 * (x - 0.5F) * x);
    EXPECT_FALSE(unused.grad().defined());
  }
}

TEST(Gpu, ReplayedPassesGiveWhatLaunchedOnesGive) {
  MALUS_NEEDS_GPU();
  const WithoutTf32 exact;
  for (const auto& name : network_names()) {
    const auto launched = losses_and_gradients(name, torch::kCUDA, false),
               replayed = losses_and_gradients(name, torch::kCUDA, true);
    ASSERT_EQ(launched.size(), replayed.size());
    for (std::size_t i = 0; i < launched.size(); ++i)
      EXPECT_LT(largest_difference(launched[i], replayed[i]), 1e-3) << name << " " << i;
  }
}

TEST(DeviceSpeed, NamesEveryWorkAndPrecisionThatIsOffered) {
  const DeviceWork work{.device = "cpu",
                        .channels = 4,
                        .inference_batch = 1,
                        .inference_side = 16,
                        .training_batch = 1,
                        .training_side = 16,
                        .once = true};
  for (const auto& [name, lines] : {std::pair{"unet", 4u}, {"nafnet", 4u}, {"malus", 2u}}) {
    const auto speeds =
        measure_device_speed({name, name, testing::small_network(name).settings}, work);
    EXPECT_EQ(speeds.size(), lines) << name;
    for (const DeviceSpeed& speed : speeds) {
      EXPECT_GT(speed.images_per_s, 0) << name;
      EXPECT_GT(speed.other_order_images_per_s, 0) << name;
    }
  }
}

TEST(DeviceSpeed, RefusesADeviceThatIsNotThere) {
  if (torch::cuda::is_available()) GTEST_SKIP() << "there is a GPU";
  EXPECT_THROW(measure_device_speed({"unet", "unet", {}}, DeviceWork()), InputError);
}

}  // namespace
}  // namespace malus
