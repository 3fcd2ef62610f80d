#include "malus/neural/internal/validation.h"

#include "malus/base/error.h"
#include "malus/evaluate/evaluation.h"
#include "malus/image/middle.h"
#include "malus/io/picture_file.h"
#include "malus/neural/internal/camera_noise.h"
#include "malus/neural/internal/clean_scenes.h"
#include "malus/neural/named_source.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/polar/demosaick.h"
#include "malus/synthesize/scene.h"

#include <algorithm>
#include <cmath>

namespace malus {

nlohmann::ordered_json json_of(const ValidationScore& score) {
  nlohmann::ordered_json json{{"image_psnr_db", score.image_psnr_db}};
  if (score.dolp_psnr_db) json["dolp_psnr_db"] = *score.dolp_psnr_db;
  if (score.aolp_circular_deg) json["aolp_circular_deg"] = *score.aolp_circular_deg;
  return json;
}

double summed_db(const nlohmann::ordered_json& score) {
  double sum = 0;
  for (const char* metric : {"image_psnr_db", "dolp_psnr_db"})
    if (score.contains(metric))
      sum += score[metric].is_number() ? score[metric].get<double>() : std::nan("");
  return sum;
}

nlohmann::ordered_json sample_entry(const TrainingConfig& config,
                                    const std::filesystem::path& folder) {
  const NoiseModel camera = camera_of(config.models.front());
  nlohmann::ordered_json entry{{"title", "First validation frame"},
                               {"text", "In the clean scene's light."},
                               {"layout", camera.layout.name()},
                               {"white_dn", white_above_black(camera.white_dn, camera.black_dn)},
                               {"files", nlohmann::ordered_json::array()}};
  for (const char* name : kSampleNames)
    if (const std::string file = std::string(name) + ".npy"; std::filesystem::exists(folder / file))
      entry["files"].push_back({{"name", name}, {"file", (folder.filename() / file).string()}});
  return entry;
}

namespace {

// The surfaces of a validation are the same in every run, so that runs can be compared.
constexpr std::uint64_t kValidationSurfaces = 0x76616c6964617465;

// A scene's light: of a picture its middle, which is polarized as pictures are in training where
// the sensor sees it. Unpolarized, its DoLP and AoLP would be none, and tell nothing of a network.
std::vector<StokesPlanes> validation_light(const TrainingConfig& config, std::size_t index) {
  const std::filesystem::path& path = config.validation_scenes[index];
  if (std::filesystem::is_directory(path)) return load_angle_scene(path);
  std::vector<StokesPlanes> light = load_picture_scene(path, config.tone);
  const SensorLayout layout = config.package.layout();
  if (!layout.polarized() || !config.data.polarized) return light;
  for (StokesPlanes& color : light) color.s0 = middle_of(color.s0, layout, config.validation.crop);
  return polarized_picture(light, kValidationSurfaces, static_cast<std::uint32_t>(index));
}

}  // namespace

Validation::Validation(const TrainingConfig& config, std::uint64_t seed, Progress& progress)
    : settings_(config.package.settings) {
  if (config.validation_scenes.empty()) return;
  const auto noise =
      open_camera(config.models.front(), config.package,
                  {.settings = config.synthesis,
                   .only_flows = std::ranges::all_of(config.models, names_noise_flow)});
  naming_source(config.source.string(), [&] { noise->require_drawable(); });
  const NoiseModel& camera = noise->camera();
  const double white = white_above_black(camera.white_dn, camera.black_dn);
  std::uint32_t number = 0;
  progress.begin("validation frames",
                 std::ssize(config.validation_scenes) * std::ssize(config.cases));
  for (std::size_t scene = 0; scene < config.validation_scenes.size(); ++scene) {
    const std::filesystem::path& folder = config.validation_scenes[scene];
    const std::vector<StokesPlanes> light = validation_light(config, scene);
    // Held to white, as in training: no frame shows more, and nothing could reach such a reference.
    const auto middle = [&](const Image& whole) {
      Image part = middle_of(whole, camera.layout, config.validation.crop);
      for (float& v : part.values()) v = std::clamp(v, 0.0F, 1.0F) * static_cast<float>(white);
      return part;
    };
    const Image clean = middle(mosaic_of(light, camera.layout));
    Planes rgb;
    if (config.package.gives_picture()) {
      rgb = intensity_of(light);
      for (Image& plane : rgb) plane = middle(plane);
    }
    for (const LightCase& shot : config.cases) {
      check_stop(progress);
      CameraNoise::Drawn drawn = naming_source(config.source.string(), [&] {
        return naming_key("cases in [validation]", [&] {
          return noise->draw(clean, noise->setting_of(shot.gain), shot.ratio, seed, number++);
        });
      });
      RawFrame noisy = std::move(drawn.noisy);
      noisy.source = folder.string();
      frames_.push_back(
          {prepare_network_frame(std::move(noisy), drawn.profile, config.package.settings, {},
                                 shot.ratio, silent_progress(),
                                 {.variance = config.package.corrects_guide()}),
           clean, rgb, shot.ratio, white});
      progress.advance(1);
    }
  }
  std::vector<GainSetting> gains;
  for (const LightCase& shot : config.cases) gains.push_back(noise->setting_of(shot.gain));
  if (const std::string line = noise->complaint(gains); !line.empty()) complaints_.push_back(line);
  std::vector<Image> noisy, guides;
  for (const Frame& frame : frames_) {
    noisy.push_back(frame.noisy.frame.dn);
    if (!frame.noisy.guide_dn.empty()) guides.push_back(frame.noisy.guide_dn);
  }
  noisy_ = mean_score(noisy);
  if (!guides.empty()) guide_ = mean_score(guides);
}

torch::Tensor Validation::output(const Frame& frame, Network& network,
                                 const NetworkPackage& package) const {
  const torch::NoGradGuard no_gradients;
  const auto device = network.parameters().front().device();
  const MosaicWindow whole{0, 0, frame.reference_dn.rows(), frame.reference_dn.cols()};
  return apply_network(network, package, prepare_input(frame.noisy, whole).to(device))
      .to(torch::kCPU, torch::kFloat32);
}

Image Validation::result(const Frame& frame, Network& network,
                         const NetworkPackage& package) const {
  Image mosaic = restore_output(frame.noisy, output(frame, network, package),
                                {0, 0, frame.reference_dn.rows(), frame.reference_dn.cols()});
  finish_output(frame.noisy, mosaic);
  return mosaic;
}

ValidationScore Validation::score(Network& network, const NetworkPackage& package,
                                  const Progress& progress) const {
  std::vector<torch::Tensor> pictures;
  std::vector<Image> results;
  for (const Frame& frame : frames_) {
    check_stop(progress);
    if (package.gives_picture())
      pictures.push_back(output(frame, network, package));
    else
      results.push_back(result(frame, network, package));
  }
  return package.gives_picture() ? picture_score(pictures) : mean_score(results);
}

void Validation::save_sample(Network& network, const NetworkPackage& package,
                             const std::filesystem::path& folder) const {
  MALUS_REQUIRE(!empty());
  const Frame& frame = frames_.front();
  std::filesystem::create_directories(folder);
  SaveOptions options;
  options.type = SampleType::kFloat;
  options.force = true;
  const auto save = [&](const std::string& name, Image dn, double ratio) {
    for (float& v : dn.values()) v *= static_cast<float>(ratio);
    save_picture(folder / (name + ".npy"), dn, options);
  };
  save("noisy", frame.noisy.frame.dn, frame.ratio);
  if (!frame.noisy.guide_dn.empty()) save("guide", frame.noisy.guide_dn, frame.ratio);
  save("network", result(frame, network, package), frame.ratio);
  save("clean", frame.reference_dn, 1);
}

ValidationScore Validation::picture_score(const std::vector<torch::Tensor>& pictures) const {
  ValidationScore score;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    const Frame& frame = frames_[i];
    Planes reference_dn = frame.reference_rgb_dn;
    for (Image& plane : reference_dn)
      for (float& v : plane.values()) v /= static_cast<float>(frame.ratio);
    const int rows = reference_dn.rows(), cols = reference_dn.cols();
    const FrameDomain& domain = frame.noisy.domain;
    const double peak =
        settings_.gives() == NetworkTarget::kSrgb ? 1.0 : frame.peak_dn / frame.ratio;
    const Evaluation e = evaluate_planes(
        picture_of(settings_, domain, picture_target(settings_, domain, reference_dn), rows, cols),
        picture_of(settings_, domain, pictures[i], rows, cols), peak);
    score.image_psnr_db += e.image_psnr_db.value_or(0) / static_cast<double>(pictures.size());
  }
  return score;
}

ValidationScore Validation::mean_score(const std::vector<Image>& mosaics) const {
  if (settings_.gives() != NetworkTarget::kMosaic) {
    std::vector<torch::Tensor> pictures;
    for (std::size_t i = 0; i < mosaics.size(); ++i) {
      const NetworkFrame& frame = frames_[i].noisy;
      pictures.push_back(
          picture_target(settings_, frame.domain, demosaick_bayer(mosaics[i], frame.frame.layout)));
    }
    return picture_score(pictures);
  }
  ValidationScore score;
  MeanOfDecided dolp_psnr_db, aolp_circular_deg;
  for (std::size_t i = 0; i < mosaics.size(); ++i) {
    Image test = mosaics[i];
    for (float& v : test.values()) v *= static_cast<float>(frames_[i].ratio);
    const Evaluation e = evaluate_mosaics(frames_[i].reference_dn, test,
                                          frames_[i].noisy.frame.layout, frames_[i].peak_dn);
    score.image_psnr_db += e.image_psnr_db.value_or(0) / static_cast<double>(mosaics.size());
    dolp_psnr_db.add(e.dolp_psnr_db);
    aolp_circular_deg.add(e.aolp_circular_deg);
  }
  score.dolp_psnr_db = dolp_psnr_db.mean();
  score.aolp_circular_deg = aolp_circular_deg.mean();
  return score;
}

}  // namespace malus
