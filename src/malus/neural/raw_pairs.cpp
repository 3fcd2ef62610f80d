#include "malus/neural/internal/raw_pairs.h"

#include "malus/base/error.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/neural/internal/camera_noise.h"
#include "malus/neural/internal/recorded_pairs.h"
#include "malus/neural/named_source.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/synthesize/scene.h"

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

// Clean scenes with the noise of a random sensor.
class SyntheticPairs final : public PairSource {
 public:
  explicit SyntheticPairs(const TrainingConfig& config)
      : scenes_(config),
        with_picture_(config.package.gives_picture()),
        noise_(config.noise),
        exposure_low_(config.data.exposure_low),
        exposure_high_(config.data.exposure_high) {
    CameraNoiseOptions options{.settings = config.synthesis,
                               .jitter = noise_.jitter,
                               .only_flows = std::ranges::all_of(config.models, names_noise_flow)};
    for (const auto& path : config.models) {
      cameras_.push_back(open_camera(path, config.package, options));
      naming_source(config.source.string(),
                    [&] { require_served(*cameras_.back(), config.models.size() > 1); });
      options.or_grey = true;  // but the first, which validation is of
    }
  }

  RawPair pair(std::uint64_t seed, std::uint32_t number) const override {
    RandomSequence random(seed, number, Draw::kParameters, kStreamPair);
    const CameraNoise& noise = *cameras_[pick(random, cameras_.size())];
    const GainSetting gain =
        noise_.gains.empty() ? noise.random_gain(seed, number)
                             : noise.setting_of(noise_.gains[pick(random, noise_.gains.size())]);
    const double ratio = log_between(random, noise_.ratio_low, noise_.ratio_high);
    const double exposure = log_between(random, exposure_low_, exposure_high_);
    const std::vector<StokesPlanes> light = scenes_.draw(seed, number);
    const NoiseModel& camera = noise.camera();
    const double white = white_above_black(camera.white_dn, camera.black_dn);
    const auto exposed = [&](Image image) {
      for (float& v : image.values())
        v = static_cast<float>(std::clamp(static_cast<double>(v) * exposure, 0.0, 1.0) * white);
      return image;
    };
    const Image clean = exposed(mosaic_of(light, camera.layout));
    CameraNoise::Drawn drawn = noise.draw(clean, gain, ratio, seed, number);
    RawPair pair;
    pair.noisy = std::move(drawn.noisy);
    pair.noisy.source = fmt::format("example {}", number);
    pair.profile = std::move(drawn.profile);
    pair.ratio = ratio;
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

  std::size_t size() const override { return scenes_.size(); }

  std::vector<std::string> complaints() const override {
    std::vector<std::string> lines;
    for (const auto& camera : cameras_) {
      std::vector<GainSetting> gains;
      for (const double gain : noise_.gains) gains.push_back(camera->setting_of(gain));
      if (const std::string line = camera->complaint(gains); !line.empty()) lines.push_back(line);
    }
    return lines;
  }

 private:
  // What no example could be drawn with fails here, where the configuration is known.
  void require_served(const CameraNoise& camera, bool one_of_several) const {
    camera.require_drawable();
    const std::string whose = one_of_several ? ", of " + camera.camera().sensor : "";
    naming_key("gains in [noise]" + whose, [&] {
      for (const double gain : noise_.gains) camera.require_gain(camera.setting_of(gain));
    });
  }

  CleanScenes scenes_;
  bool with_picture_;
  std::vector<std::unique_ptr<const CameraNoise>> cameras_;
  TrainingNoiseSettings noise_;
  double exposure_low_, exposure_high_;
};

// Several sources, each by its size: a sample in a shard is drawn as often as a picture.
class MixedPairs final : public PairSource {
 public:
  void add(std::string name, std::unique_ptr<PairSource> source) {
    names_.push_back(std::move(name));
    sizes_.push_back(source->size());
    sources_.push_back(std::move(source));
  }
  std::size_t size() const override {
    return std::accumulate(sizes_.begin(), sizes_.end(), std::size_t{0});
  }
  nlohmann::ordered_json shares() const override {
    if (sources_.size() < 2) return {};
    nlohmann::ordered_json shares;
    for (std::size_t i = 0; i < sources_.size(); ++i)
      shares[names_[i]] = {{"size", sizes_[i]},
                           {"share", static_cast<double>(sizes_[i]) / static_cast<double>(size())}};
    return shares;
  }
  RawPair pair(std::uint64_t seed, std::uint32_t number) const override {
    RandomSequence random(seed, number, Draw::kParameters, kStreamPairSource);
    std::size_t at = pick(random, size());
    std::size_t i = 0;
    while (at >= sizes_[i]) at -= sizes_[i++];
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
  std::vector<std::string> names_;
  std::vector<std::unique_ptr<PairSource>> sources_;
  std::vector<std::size_t> sizes_;
};

}  // namespace

std::unique_ptr<PairSource> make_pair_source(const TrainingConfig& config) {
  auto mixed = std::make_unique<MixedPairs>();
  if (!config.pictures.empty() || !config.scenes.empty())
    mixed->add("pictures and scenes", std::make_unique<SyntheticPairs>(config));
  if (!config.shards.empty()) mixed->add("samples of shards", open_shards(config));
  if (!config.pairs.empty()) mixed->add("captured pairs", open_captured_pairs(config));
  return mixed;
}

}  // namespace malus
