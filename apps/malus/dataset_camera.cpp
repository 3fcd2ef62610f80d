#include "dataset_camera.h"

#include "malus/base/error.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/noise/frame_levels.h"
#include "malus/synthesize/model.h"

#include <map>
#include <utility>

#include "flags.h"
#include "networks_door.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

class CalibratedDataset final : public DatasetCamera {
 public:
  CalibratedDataset(const fs::path& path, DatasetSettings dataset, const SynthesisSettings& noise)
      : path_(path), dataset_(std::move(dataset)), noise_(noise), model_(load_model(path)) {}

  void prepare() override {
    for (const double ratio : dataset_.ratios) {
      SynthesisSettings settings = noise_;
      settings.ratio = ratio;
      synthesizers_.emplace(ratio, Synthesizer(model_.shared_description(), settings));
    }
  }

  const NoiseModel& camera() const override { return model_.description(); }
  nlohmann::ordered_json noise_json() const override { return settings_json(noise_); }

  TrainingPair pair(const SampleRecipe& recipe, View<const float> source_dn,
                    std::uint64_t seed) const override {
    std::optional<GainSetting> gain;
    if (recipe.gain) gain = model_.gain_setting(*recipe.gain);
    return make_pair_of(recipe, dataset_, source_dn, synthesizers_.at(recipe.ratio), gain, seed);
  }

  void try_gains() const override {
    const Image cell(camera().layout.rows(), camera().layout.cols());
    for (const GainSetting& gain : gains_to_try()) any().draw(cell, gain, {});
  }

  std::vector<std::string> cautions() const override {
    std::vector<std::string> lines;
    if (const std::string line = untold_gain_complaint(camera(), gains_to_try()); !line.empty())
      lines.push_back(path_.string() + ": " + line);
    if (const std::string repeated = any().repetition(dataset_.patch, dataset_.patch);
        !repeated.empty())
      lines.push_back(repeated);
    return lines;
  }

 private:
  const Synthesizer& any() const { return synthesizers_.begin()->second; }

  // Those that are listed; where none are, those of dark frames. Other kinds have any calibrated
  // one.
  std::vector<GainSetting> gains_to_try() const {
    std::vector<GainSetting> gains;
    for (const double gain : dataset_.gains) gains.push_back(model_.gain_setting(gain));
    if (gains.empty() && synthesis_kind(noise_.kind) == SynthesisKind::kDarkFrames)
      for (const DarkFrameBank& bank : camera().dark_frames) gains.push_back(bank.gain);
    return gains;
  }

  fs::path path_;
  DatasetSettings dataset_;
  SynthesisSettings noise_;
  Model model_;
  std::map<double, Synthesizer> synthesizers_;  // by ratio
};

class FlowDataset final : public DatasetCamera {
 public:
  FlowDataset(const fs::path& path, DatasetSettings dataset, const SynthesisSettings& noise)
      : path_(path),
        dataset_(std::move(dataset)),
        noise_(noise),
        flow_(networks().open_flow(path)) {
    camera_.sensor = flow_->camera_name();
    camera_.layout = SensorLayout::named(flow_->sensor().layout);
    camera_.black_dn = flow_->sensor().black_dn;
    camera_.white_dn = flow_->sensor().white_dn;
    camera_.quantization_dn = flow_->sensor().spread_dn;
  }

  void prepare() override {
    SynthesisSettings plain;
    plain.debias = noise_.debias;
    plain.amplify = noise_.amplify;
    if (settings_json(plain) != settings_json(noise_))
      throw InputError(path_.string(),
                       "a Noise Flow has none of the parts that these settings of [noise] change",
                       "of [noise] give debias and amplify alone");
  }

  const NoiseModel& camera() const override { return camera_; }
  nlohmann::ordered_json noise_json() const override {
    return {{"amplify", noise_.amplify}, {"debias", noise_.debias}};
  }

  TrainingPair pair(const SampleRecipe& recipe, View<const float> source_dn,
                    std::uint64_t seed) const override {
    TrainingPair pair;
    pair.gain = gain_of(recipe, seed);
    pair.clean_dn = clean_patch_of(recipe, dataset_, source_dn, camera_.layout);
    Image light = pair.clean_dn;
    for (float& v : light.values()) v = static_cast<float>(v / recipe.ratio);
    pair.noisy_dn = flow_->draw(light, pair.gain, {.seed = seed, .frame = recipe.number});
    if (noise_.debias)
      for (const ChannelProfile& channel : flow_->profile_at(pair.gain).channels)
        pair.removed_bias_dn += channel.bias_dn / camera_.layout.channels();
    const double factor = noise_.amplify ? recipe.ratio : 1.0;
    for (float& v : pair.noisy_dn.values())
      v = static_cast<float>((v - pair.removed_bias_dn) * factor);
    if (!noise_.amplify) pair.clean_dn = std::move(light);
    return pair;
  }

  void try_gains() const override {
    const Image cell(camera_.layout.rows(), camera_.layout.cols());
    for (const double gain : dataset_.gains)
      flow_->draw(cell, flow_->sensor().setting_of(gain), {});
  }

  std::vector<std::string> cautions() const override { return {}; }

 private:
  GainSetting gain_of(const SampleRecipe& recipe, std::uint64_t seed) const {
    if (recipe.gain) return flow_->sensor().setting_of(*recipe.gain);
    const auto gains = flow_->sensor().trained_gains();
    RandomSequence random(seed, recipe.number, Draw::kParameters, kStreamFlowGain);
    return gains[pick(random, gains.size())];
  }

  fs::path path_;
  DatasetSettings dataset_;
  SynthesisSettings noise_;
  std::unique_ptr<FlowSampler> flow_;
  NoiseModel camera_;
};

}  // namespace

std::unique_ptr<DatasetCamera> open_dataset_camera(const fs::path& model,
                                                   const DatasetSettings& dataset,
                                                   const SynthesisSettings& noise) {
  if (names_noise_flow(model)) return std::make_unique<FlowDataset>(model, dataset, noise);
  return std::make_unique<CalibratedDataset>(model, dataset, noise);
}

}  // namespace malus::app
