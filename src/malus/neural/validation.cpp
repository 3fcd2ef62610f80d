#include "malus/neural/validation.h"

#include "malus/base/error.h"
#include "malus/evaluate/evaluation.h"
#include "malus/io/picture_file.h"
#include "malus/neural/clean_scenes.h"
#include "malus/neural/raw_pairs.h"
#include "malus/synthesize/model.h"
#include "malus/synthesize/scene.h"

namespace malus {

Validation::Validation(const TrainingConfig& config, std::uint64_t seed, Progress& progress) {
  if (config.validation_scenes.empty()) return;
  const Model model(load_model(config.models.front()));
  const NoiseModel& camera = model.description();
  const double white = camera.white_dn - camera.black_dn.front();
  std::uint32_t number = 0;
  for (const auto& folder : config.validation_scenes) {
    Image clean = middle_of(mosaic_of(load_angle_scene(folder), camera.layout), camera.layout,
                            config.validation.crop);
    for (float& v : clean.values()) v *= static_cast<float>(white);
    for (const ValidationCase& light : config.cases) {
      check_stop(progress);
      SynthesisSettings synthesis = config.synthesis;
      synthesis.ratio = light.ratio;
      const GainSetting gain = model.gain_setting(light.gain);
      RawFrame noisy = Synthesizer(camera, synthesis)
                           .draw_raw(clean, gain, {.seed = seed, .frame = number++},
                                     camera.black_dn, camera.white_dn);
      noisy.source = folder.string();
      frames_.push_back({prepare_network_frame(std::move(noisy), camera.profile_at(gain),
                                               config.package.settings, {}, light.ratio, progress),
                         clean, light.ratio, white});
    }
  }
  std::vector<Image> noisy, guides;
  for (const Frame& frame : frames_) {
    noisy.push_back(frame.noisy.frame.dn);
    if (!frame.noisy.guide_dn.empty()) guides.push_back(frame.noisy.guide_dn);
  }
  noisy_ = mean_score(noisy);
  if (!guides.empty()) guide_ = mean_score(guides);
}

Image Validation::result(const Frame& frame, Network& network,
                         const NetworkPackage& package) const {
  const torch::NoGradGuard no_gradients;
  const auto device = network.parameters().front().device();
  const MosaicWindow whole{0, 0, frame.reference_dn.rows(), frame.reference_dn.cols()};
  const auto planes = apply_network(network, package, prepare_input(frame.noisy, whole).to(device));
  return restore_output(frame.noisy, planes, whole);
}

ValidationScore Validation::score(Network& network, const NetworkPackage& package) const {
  std::vector<Image> results;
  for (const Frame& frame : frames_) results.push_back(result(frame, network, package));
  return mean_score(results);
}

nlohmann::ordered_json Validation::save_sample(Network& network, const NetworkPackage& package,
                                               const std::filesystem::path& folder) const {
  MALUS_REQUIRE(!empty());
  const Frame& frame = frames_.front();
  std::filesystem::create_directories(folder);
  nlohmann::ordered_json entry{{"title", "First validation frame"},
                               {"text", "In the clean scene's light."},
                               {"layout", frame.noisy.frame.layout.name()},
                               {"white_dn", frame.peak_dn},
                               {"files", nlohmann::ordered_json::array()}};
  SaveOptions options;
  options.type = SampleType::kFloat;
  options.force = true;
  const auto save = [&](const std::string& name, Image dn, double ratio) {
    for (float& v : dn.values()) v *= static_cast<float>(ratio);
    save_picture(folder / (name + ".npy"), dn, options);
    const auto file = folder.filename() / (name + ".npy");
    entry["files"].push_back({{"name", name}, {"file", file.string()}});
  };
  save("noisy", frame.noisy.frame.dn, frame.ratio);
  if (!frame.noisy.guide_dn.empty()) save("guide", frame.noisy.guide_dn, frame.ratio);
  save("network", result(frame, network, package), frame.ratio);
  save("clean", frame.reference_dn, 1);
  return entry;
}

ValidationScore Validation::mean_score(const std::vector<Image>& results) const {
  ValidationScore score;
  for (std::size_t i = 0; i < results.size(); ++i) {
    Image test = results[i];
    for (float& v : test.values()) v *= static_cast<float>(frames_[i].ratio);
    const Evaluation e = evaluate_mosaics(frames_[i].reference_dn, test,
                                          frames_[i].noisy.frame.layout, frames_[i].peak_dn);
    const auto n = static_cast<double>(results.size());
    score.image_psnr_db += e.image_psnr_db.value_or(0) / n;
    score.dolp_psnr_db += e.dolp_psnr_db.value_or(0) / n;
    score.aolp_circular_deg += e.aolp_circular_deg.value_or(0) / n;
  }
  return score;
}

}  // namespace malus
