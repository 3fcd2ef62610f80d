#include "malus/neural/internal/raw_pairs.h"

#include "malus/base/error.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/neural/internal/recorded_pairs.h"
#include "malus/neural/named_source.h"
#include "malus/noise/fixed_pattern.h"
#include "malus/noise/frame_levels.h"
#include "malus/synthesize/scene.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <cmath>
#include <memory>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

double log_between(RandomSequence& random, double low, double high) {
  return low * std::pow(high / low, random.uniform());
}

void multiply(std::vector<double>& values, double factor) {
  for (double& value : values) value *= factor;
}

void multiply(ChannelStatistics& statistics, double factor) {
  multiply(statistics.mean, factor);
  multiply(statistics.spread, factor);
  multiply(statistics.covariance.values, factor * factor);
}

// Clean scenes with the noise of a random sensor.
class SyntheticPairs final : public PairSource {
 public:
  explicit SyntheticPairs(const TrainingConfig& config)
      : scenes_(config),
        with_picture_(config.package.gives_picture()),
        paths_(config.models),
        noise_(config.noise),
        synthesis_(config.synthesis),
        exposure_low_(config.data.exposure_low),
        exposure_high_(config.data.exposure_high) {
    for (const auto& path : config.models) {
      NoiseModel model = load_camera(path, config.package);
      drop_maps(model);  // large, and drawn noise has none of them
      models_.push_back(std::make_shared<const NoiseModel>(std::move(model)));
      if (noise_.jitter > 0 && (models_.back()->physics.empty() ||
                                synthesis_kind(synthesis_.kind) != SynthesisKind::kPhysics))
        throw InputError(path.string(), "cannot be varied: jitter is for kind \"physics\"",
                         "use jitter = 0");
      naming_source(config.source.string(), [&] { require_served(models_.back()); });
    }
  }

  RawPair pair(std::uint64_t seed, std::uint32_t number) const override {
    RandomSequence random(seed, number, Draw::kParameters, kStreamPair);
    const std::shared_ptr<const NoiseModel>& base = models_[pick(random, models_.size())];
    GainSetting gain = random_gain(*base, synthesis_, seed, number);
    if (!noise_.gains.empty())
      gain = base->setting_of(noise_.gains[pick(random, noise_.gains.size())]);
    SynthesisSettings synthesis = synthesis_;
    synthesis.ratio = log_between(random, noise_.ratio_low, noise_.ratio_high);
    const double exposure = log_between(random, exposure_low_, exposure_high_);
    const GainRange gains = gain_range(synthesis.extrapolate_gain);
    const std::shared_ptr<const NoiseModel> varied =
        noise_.jitter > 0 ? std::make_shared<const NoiseModel>(
                                jittered_sensor(*base, gain, noise_.jitter, seed, number, gains))
                          : base;
    const NoiseModel& sensor = *varied;
    const std::vector<StokesPlanes> light = scenes_.draw(seed, number);
    const double white = white_above_black(sensor.white_dn, sensor.black_dn);
    const auto exposed = [&](Image image) {
      for (float& v : image.values())
        v = static_cast<float>(std::clamp(static_cast<double>(v) * exposure, 0.0, 1.0) * white);
      return image;
    };
    const Image clean = exposed(mosaic_of(light, sensor.layout));
    RawPair pair;
    const Synthesizer synthesizer(varied, synthesis);
    pair.noisy = synthesizer.draw_raw(
        clean, gain, synthesizer.somewhere(clean.rows(), clean.cols(), seed, number),
        sensor.black_dn, sensor.white_dn);
    pair.noisy.source = fmt::format("example {}", number);
    pair.profile = sensor.profile_at(gain, gains);
    if (!synthesis.bias) pair.profile.clear_bias();
    pair.ratio = synthesis.ratio;
    const auto dimmed = [&](Image image) {
      for (float& v : image.values()) v = static_cast<float>(static_cast<double>(v) / pair.ratio);
      return image;
    };
    pair.clean_dn = dimmed(clean);
    if (with_picture_) {
      pair.clean_rgb_dn = intensity_of(light);
      for (Image& plane : pair.clean_rgb_dn) plane = dimmed(exposed(std::move(plane)));
    }
    return pair;
  }

  std::vector<std::string> complaints() const override {
    std::vector<std::string> lines;
    for (std::size_t i = 0; i < models_.size(); ++i) {
      std::vector<GainSetting> gains;
      for (const double gain : noise_.gains) gains.push_back(models_[i]->setting_of(gain));
      if (const std::string line = untold_gain_complaint(*models_[i], gains); !line.empty())
        lines.push_back(paths_[i].string() + ": " + line);
    }
    return lines;
  }

 private:
  // What no example could be drawn with fails here, where the configuration is known.
  void require_served(const std::shared_ptr<const NoiseModel>& model) const {
    const Synthesizer of_this_kind(model, synthesis_);
    for (const double gain : noise_.gains) {
      const GainSetting setting = model->setting_of(gain);
      of_this_kind.require_gain(setting);
      model->profile_at(setting, gain_range(synthesis_.extrapolate_gain));
    }
  }

  CleanScenes scenes_;
  bool with_picture_;
  std::vector<std::shared_ptr<const NoiseModel>> models_;
  std::vector<std::filesystem::path> paths_;  ///< of the models
  TrainingNoiseSettings noise_;
  SynthesisSettings synthesis_;
  double exposure_low_, exposure_high_;
};

// Several sources, each by its weight.
class MixedPairs final : public PairSource {
 public:
  void add(std::unique_ptr<PairSource> source, std::size_t weight) {
    sources_.push_back(std::move(source));
    weights_.push_back(weight);
  }
  RawPair pair(std::uint64_t seed, std::uint32_t number) const override {
    RandomSequence random(seed, number, Draw::kParameters, kStreamPairSource);
    std::size_t at =
        pick(random, std::accumulate(weights_.begin(), weights_.end(), std::size_t{0}));
    std::size_t i = 0;
    while (at >= weights_[i]) at -= weights_[i++];
    return sources_[i]->pair(seed, number);
  }
  std::vector<std::string> complaints() const override {
    std::vector<std::string> lines;
    for (const auto& source : sources_)
      for (std::string& line : source->complaints())
        if (std::ranges::find(lines, line) == lines.end()) lines.push_back(std::move(line));
    return lines;
  }

 private:
  std::vector<std::unique_ptr<PairSource>> sources_;
  std::vector<std::size_t> weights_;
};

}  // namespace

NoiseModel load_camera(const std::filesystem::path& path, const NetworkPackage& package) {
  NoiseModel model = load_model(path);
  if (!(model.layout == package.layout()))
    throw InputError(path.string(),
                     fmt::format("is of a sensor with the layout {}, the package of {}",
                                 model.layout.name(), package.settings.layout),
                     "name a model of the package's layout");
  return model;
}

NoiseModel jittered_sensor(const NoiseModel& model, const GainSetting& gain, double jitter,
                           std::uint64_t seed, std::uint32_t number, GainRange range) {
  RandomSequence random(seed, number, Draw::kParameters, kStreamJitter);
  const auto factor = [&] { return std::exp(jitter * random.normal()); };
  PhysicsCalibration entry = calibration_of(model.parameters_at(gain, range));
  multiply(entry.K, factor());
  multiply(entry.sigma_tl, factor());
  multiply(entry.sigma_row, factor());
  multiply(entry.mu, factor());
  NoiseModel sensor = sensor_alone(model);
  sensor.origin += ", varied";
  sensor.physics = {std::move(entry)};
  return sensor;
}

std::unique_ptr<PairSource> make_pair_source(const TrainingConfig& config) {
  auto mixed = std::make_unique<MixedPairs>();
  if (const std::size_t clean = config.pictures.size() + config.scenes.size(); clean > 0)
    mixed->add(std::make_unique<SyntheticPairs>(config), clean);
  if (!config.shards.empty()) mixed->add(open_shards(config), config.shards.size());
  if (!config.pairs.empty()) mixed->add(open_captured_pairs(config), config.pairs.size());
  return mixed;
}

}  // namespace malus
