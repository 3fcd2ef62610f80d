// What `malus train CONFIG.toml` reads: which network, from which data, with which noise, how long.
// Every setting is declared once, in the struct that holds it.
#pragma once

#include "malus/base/parameter.h"
#include "malus/neural/package.h"
#include "malus/synthesize/light_case.h"
#include "malus/synthesize/synthesizer.h"

#include <filesystem>
#include <string>
#include <vector>

namespace malus {

/// [data]: clean pictures and captured pairs to examples.
struct TrainingDataSettings {
  int example = 256, patch = 128, pool = 32;
  double refresh = 0.25, memory_mib = 1024, exposure_low = 0.5, exposure_high = 1.5, zoom = 1;
  bool polarized = true, symmetries = true;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.example, ParameterInfo{"example", "px",
                                      "side of the piece of a frame that noise and the guide are "
                                      "made for; smaller pictures give smaller pieces",
                                      16, 8192});
    field(self.patch,
          ParameterInfo{"patch", "px", "side of what one step sees of an example, in mosaic pixels",
                        8, 8192});
    field(self.pool,
          ParameterInfo{"pool", "1", "examples that every place of a batch draws from", 1, 100000});
    field(self.refresh, ParameterInfo{"refresh", "1",
                                      "new examples per place of the batch and step; the oldest "
                                      "one leaves the pool; 0: as many as no step waits for, "
                                      "measured over the first 100 steps and, as they grow, again",
                                      0, 1});
    field(self.memory_mib,
          ParameterInfo{
              "memory", "MiB",
              "examples together take no more than this, nor do the clean pictures that are kept",
              16, 1 << 20});
    field(self.exposure_low,
          ParameterInfo{"exposure_low", "1", "least factor on a picture's light", 1e-3, 1e3});
    field(self.exposure_high,
          ParameterInfo{"exposure_high", "1", "largest factor on a picture's light", 1e-3, 1e3});
    field(self.zoom,
          ParameterInfo{"zoom", "1", "every other piece is enlarged by up to this factor", 1, 8});
    field(self.polarized,
          ParameterInfo{"polarized", "", "pictures are given a relief that polarizes their light"});
    field(self.symmetries, ParameterInfo{"symmetries", "",
                                         "clean pictures are mirrored and turned, polarization "
                                         "with them"});
  }
};

/// [noise], beside the fields of SynthesisSettings: the range of sensors and light.
struct TrainingNoiseSettings {
  double ratio_low = 1, ratio_high = 1, jitter = 0;
  std::vector<double> gains;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    field(self.ratio_low,
          ParameterInfo{"ratio_low", "1", "least low-light ratio; drawn evenly in the logarithm",
                        kLeastRatio, kMostRatio});
    field(self.ratio_high,
          ParameterInfo{"ratio_high", "1", "largest low-light ratio", kLeastRatio, kMostRatio});
    field(self.gains, ParameterInfo{"gains", "",
                                    "gains in the model's unit, one drawn per example; empty: "
                                    "random in log K over the calibrated range",
                                    -kInfinity, kInfinity});
    field(self.jitter, ParameterInfo{"jitter", "1",
                                     "other sensors: K, read and row noise are multiplied by "
                                     "exp(jitter * normal), each with its own draw",
                                     0, 2});
  }
};

/// [train].
struct TrainSettings {
  int steps = 1000, batch = 8, warm_up = 100, step_every = 1000, checkpoint_every = 200,
      log_every = 10;
  double learning_rate = 2e-4, final_rate = 0.01, step_factor = 0.5, beta1 = 0.9, beta2 = 0.999,
         clip = 1.0, average = 0.999, stokes_weight = 1.0, timeout_s = 300;
  std::string schedule = "cosine", loss = "both", precision = "auto", device = "auto";
  bool recorded = true;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field);
};

template <class Self, class Visitor>
void TrainSettings::describe(Self& self, Visitor&& field) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  const auto number = [&](auto& value, const char* name, const char* unit, const char* help,
                          double low, double high) {
    field(value, ParameterInfo{name, unit, help, low, high});
  };
  const auto choice = [&](auto& value, const char* name, const char* help,
                          std::vector<std::string> choices) {
    field(value, ParameterInfo{name, "", help, -kInfinity, kInfinity, std::move(choices)});
  };
  number(self.steps, "steps", "1", "optimiser steps", 1, 2e9);
  number(self.batch, "batch", "1", "patches per step, over all workers together", 1, 65536);
  number(self.learning_rate, "learning_rate", "1", "Adam's, after the warm-up", 0, 1);
  choice(self.schedule, "schedule", "what the rate does after the warm-up",
         {"cosine", "step", "constant"});
  number(self.warm_up, "warm_up", "steps", "steps over which the rate rises linearly", 0, 1e9);
  number(self.final_rate, "final_rate", "1", "cosine: the last rate, of the first", 0, 1);
  number(self.step_every, "step_every", "steps", "step: the rate is multiplied this often", 1, 1e9);
  number(self.step_factor, "step_factor", "1", "step: by this", 0, 1);
  number(self.beta1, "beta1", "1", "Adam: memory of the mean", 0, 0.999999);
  number(self.beta2, "beta2", "1", "Adam: memory of the variance", 0, 0.999999);
  number(self.clip, "clip", "1", "largest norm of the gradient; 0: no limit", 0, 1e9);
  number(self.average, "average", "1",
         "memory of the moving average of weights that is validated and shipped; 0: none", 0,
         0.9999999);
  choice(self.loss, "loss",
         "000, Eq. 8 and 9, in the network's domain; of layouts without polarizer angles l1",
         {"l1", "stokes", "both"});
  number(self.stokes_weight, "stokes_weight", "1", "both: weight of the Stokes part", 0, 1e6);
  choice(self.precision, "precision",
         "bfloat16: convolutions and products in half the bits; auto: float32, which trained unet "
         "and nafnet faster on an H100 (docs/networks.md)",
         {"auto", "float32", "bfloat16"});
  choice(self.device, "device", "auto: a GPU where libtorch has one", {"auto", "cpu", "cuda"});
  field(self.recorded, ParameterInfo{"recorded", "",
                                     "on a GPU the passes of one step are recorded and replayed, "
                                     "which takes up to twice the memory and less time"});
  number(self.checkpoint_every, "checkpoint_every", "steps", "steps between checkpoints", 1, 1e9);
  number(self.log_every, "log_every", "steps", "steps between lines of the log", 1, 1e9);
  number(self.timeout_s, "timeout", "s", "a worker that is silent for longer is lost", 1, 86400);
}

/// [validation].
struct ValidationSettings {
  int every = 500, crop = 512;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    field(self.every, ParameterInfo{"every", "steps", "steps between validations", 1, 1e9});
    field(self.crop,
          ParameterInfo{"crop", "px", "middle part of the scenes that is used", 16, 65536});
  }
};

struct TrainingConfig {
  std::filesystem::path source;
  NetworkPackage package;
  std::vector<std::filesystem::path> pictures;  ///< clean RGB or grey pictures
  std::vector<std::filesystem::path> scenes;    ///< folders with I0, I45, I90, I135
  std::vector<std::filesystem::path> shards;    ///< of malus dataset
  std::vector<std::filesystem::path> pairs;     ///< pairs.json of malus pairs
  std::string tone = "auto";                    ///< of the pictures: auto, srgb, linear
  std::vector<std::filesystem::path> models;    ///< noise models, files or built-in names
  TrainingDataSettings data;
  TrainingNoiseSettings noise;
  SynthesisSettings synthesis;
  TrainSettings train;
  std::filesystem::path begin_with;  ///< weight file that a new run starts from; empty: at random
  ValidationSettings validation;
  std::vector<std::filesystem::path> validation_scenes;  ///< folders as scenes, or pictures
  std::vector<LightCase> cases;
};

/// What a caller puts in place of the file's: pairs (then the file's pictures, scenes and shards
/// are left out too), noise models, and any setting (ConfigSection::load). Empty: the file's own.
struct TrainingOverrides {
  std::vector<std::filesystem::path> pairs, models;
  std::vector<std::string> settings;
};

/// Reads and checks the file; patterns of files are relative to it. Throws InputError on anything
/// that no step could be made with.
TrainingConfig load_training_config(const std::filesystem::path& path,
                                    const TrainingOverrides& overrides = {});

/// Every setting, and what the files hold (contents.h), for the checkpoint and the record: a run
/// goes on only with the same ones. Throws InputError where a file cannot be read.
nlohmann::json config_json(const TrainingConfig& config);

}  // namespace malus
