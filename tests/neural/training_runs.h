// A small scene, a short training on it, and what came out.
#pragma once

#include "malus/base/progress.h"
#include "malus/io/picture_file.h"
#include "malus/neural/network.h"
#include "malus/neural/package.h"
#include "malus/neural/training_config.h"

#include <cmath>
#include <filesystem>
#include <numbers>
#include <string>
#include <vector>

#include "support.h"

namespace malus::testing {

// Four pictures of a plain surface whose light is polarized at 30 degrees, brighter to the right.
struct AngleScene {
  explicit AngleScene(const TemporaryFolder& folder, int rows = 48, int cols = 64)
      : path(folder / "scene") {
    std::filesystem::create_directories(path);
    for (int k = 0; k < 4; ++k) {
      Planes planes(3, rows, cols);
      for (int r = 0; r < rows; ++r)
        for (int c = 0; c < cols; ++c)
          for (int color = 0; color < 3; ++color)
            planes[color](r, c) = static_cast<float>(
                light(c, color) * 0.5 *
                (1 + kDegree * std::cos(std::numbers::pi / 90 * (kAngle - 45.0 * k))));
      save_picture(path / ("I" + std::to_string(45 * k) + ".exr"), planes, {"R", "G", "B"});
    }
  }
  static double light(int c, int color) { return (0.2 + 0.1 * color) * (1 + c / 64.0); }
  static constexpr double kDegree = 0.4, kAngle = 30;
  std::filesystem::path path;
};

inline TrainingConfig scene_config(const AngleScene& scene) {
  TrainingConfig config;
  config.package.settings.layout = "polar-bayer-rggb";
  config.package.network =
      fitted_network({"unet", {{"width", 2}, {"levels", 2}}}, config.package.settings);
  config.scenes = {scene.path};
  config.models = {"imx250myr-simulated"};
  config.data.example = 48;
  config.data.patch = 32;
  config.data.pool = 3;
  config.data.refresh = 0.5;
  config.train.batch = 4;
  config.train.steps = 7;
  config.train.warm_up = 2;
  config.train.checkpoint_every = 1000;
  config.train.log_every = 1;
  return config;
}

inline std::vector<torch::Tensor> weights_in(const std::filesystem::path& path) {
  std::vector<torch::Tensor> all;
  for (const auto& [name, stored] : load_tensor_file(path).tensors) all.push_back(to_torch(stored));
  return all;
}

// Stops when a number of steps was made.
class StopAfter final : public Progress {
 public:
  explicit StopAfter(int steps) : left_(steps) {}
  void begin(std::string_view stage, std::int64_t) override { training_ = stage == "training"; }
  void advance(std::int64_t) override { left_ -= training_ ? 1 : 0; }
  void warn(std::string_view) override {}
  bool stop_requested() const override { return left_ <= 1; }

 private:
  bool training_ = false;
  int left_;
};

}  // namespace malus::testing
