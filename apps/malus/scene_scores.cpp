#include "scene_scores.h"

#include "malus/base/error.h"
#include "malus/evaluate/evaluation.h"
#include "malus/io/angle_pictures.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <chrono>

#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

// Where a mosaic pixel's colour is found in an RGB picture; 0 in a picture of one channel.
int picture_channel(Color color, int channels) {
  if (channels < 3) return 0;
  return color == Color::kRed ? 0 : color == Color::kBlue ? 2 : 1;
}

}  // namespace

CleanScene load_scene(const fs::path& folder, const NoiseModel& model, int crop) {
  const std::array<Picture, 4> angles = load_angle_pictures(folder);
  const int cell = std::max(model.layout.rows(), model.layout.cols());
  const auto middle = [&](int size, int& start) {
    const int length = std::min(size, crop) / cell * cell;
    start = (size - length) / 2 / cell * cell;
    return length;
  };
  int row0 = 0, col0 = 0;
  const int rows = middle(angles[0].planes.rows(), row0),
            cols = middle(angles[0].planes.cols(), col0);
  CleanScene scene{folder.filename().string(), Image(rows, cols)};
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c) {
      const int channel = model.layout.channel_at(r, c);
      const Site& site = model.layout.site(channel);
      if (!site.angle_deg)
        throw InputError("--model", "is not of a polarization camera", "give another model");
      const Picture& picture = angles[static_cast<std::size_t>(*site.angle_deg / 45)];
      const Image& plane = picture.planes[picture_channel(site.color, picture.planes.channels())];
      const double white = model.white_dn - model.black_dn[static_cast<std::size_t>(channel)];
      scene.clean_dn(r, c) = static_cast<float>(plane(row0 + r, col0 + c) / picture.white * white);
    }
  return scene;
}

DenoiseSettings method_settings_of(const std::string& text) {
  DenoiseSettings settings;
  if (text.ends_with(".safetensors")) {
    settings.method = text;
    return settings;
  }
  std::size_t start = 0;
  for (int field = 0; start <= text.size(); ++field) {
    const std::size_t end = std::min(text.find('/', start), text.size());
    const std::string part = text.substr(start, end - start);
    if (field == 0) settings.method = part;
    if (field == 1) settings.profile = part;
    if (field == 2 && part == "no-row-noise") settings.row_noise = false;
    start = end + 1;
  }
  return settings;
}

LightCase light_case_of(const std::string& text) {
  const std::size_t colon = text.find(':');
  try {
    if (colon != std::string::npos) return {std::stod(text), std::stod(text.substr(colon + 1))};
  } catch (const std::exception&) {  // reported below
  }
  throw InputError("--cases " + text, "is not GAIN:RATIO",
                   "e.g. 12:60 for 12 dB and a sixtieth of the light");
}

NoisyScene make_noisy(const CleanScene& scene, const LightCase& light, const NoiseModel& model,
                      std::uint64_t seed) {
  SynthesisSettings synthesis;
  synthesis.ratio = light.ratio;
  const Synthesizer camera(model, synthesis);
  GainSetting gain;
  gain.gain_db = light.gain_db;
  NoisyScene noisy{camera.draw_raw(scene.clean_dn, gain, DrawAddress{.seed = seed}, model.black_dn,
                                   model.white_dn),
                   model.profile_at(gain), &scene, light.ratio,
                   model.white_dn - model.black_dn.front()};
  noisy.frame.source = scene.name;
  return noisy;
}

void add_to_score(SceneScore& score, const NoisyScene& scene, const FrameDenoiser* denoiser) {
  Image test_dn;
  if (denoiser) {
    const auto start = std::chrono::steady_clock::now();
    test_dn = (*denoiser)(scene.frame, scene.profile, silent_progress()).dn_above_black;
    score.seconds +=
        std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
  } else {
    test_dn = scene.frame.dn;
    for (int r = 0; r < test_dn.rows(); ++r)
      for (int c = 0; c < test_dn.cols(); ++c) {
        const auto channel = static_cast<std::size_t>(scene.frame.layout.channel_at(r, c));
        test_dn(r, c) -= static_cast<float>(scene.frame.black_at(r, c) +
                                            scene.profile.channels[channel].bias_dn);
      }
  }
  for (float& v : test_dn.values()) v *= static_cast<float>(scene.ratio);
  const Evaluation e =
      evaluate_mosaics(scene.clean->clean_dn, test_dn, scene.frame.layout, scene.range_dn);
  score.image_psnr_db += *e.image_psnr_db;
  score.dolp_psnr_db += e.dolp_psnr_db.value_or(0);
  score.aolp_deg += e.aolp_circular_deg.value_or(0);
  ++score.count;
}

Json score_json(const std::vector<SceneScore>& scores) {
  Json list = Json::array();
  for (const SceneScore& score : scores) {
    const double n = std::max(score.count, 1);
    list.push_back({{"name", score.name},
                    {"image_psnr_db", score.image_psnr_db / n},
                    {"dolp_psnr_db", score.dolp_psnr_db / n},
                    {"aolp_circular_deg", score.aolp_deg / n},
                    {"seconds", score.seconds / n}});
  }
  return list;
}

std::string score_text(const std::vector<SceneScore>& scores) {
  std::string table =
      "| method | image PSNR [dB] | DoLP PSNR [dB] | AoLP circular RMS [deg] | s per frame |\n"
      "|---|---|---|---|---|\n";
  for (const SceneScore& score : scores) {
    const double n = std::max(score.count, 1);
    table += fmt::format("| {} | {:.2f} | {:.2f} | {:.2f} | {:.2f} |\n", score.name,
                         score.image_psnr_db / n, score.dolp_psnr_db / n, score.aolp_deg / n,
                         score.seconds / n);
  }
  return table;
}

Json score_record(const std::string& title, const std::vector<std::string>& cases,
                  const std::string& model, const std::vector<SceneScore>& scores) {
  Json table = {{"title", "Means over scenes and cases"},
                {"note", fmt::format("Means over the scenes and over the cases (gain : low-light "
                                     "ratio) {}; noise of {}.",
                                     Json(cases).dump(), model)},
                {"head", "method"},
                {"columns",
                 {{{"name", "image PSNR"}, {"unit", "dB"}},
                  {{"name", "DoLP PSNR"}, {"unit", "dB"}},
                  {{"name", "AoLP circular error"}, {"unit", "deg"}},
                  {{"name", "time per frame"}, {"unit", "s"}}}},
                {"rows", Json::array()}};
  for (const Json& method : score_json(scores))
    table["rows"].push_back({{"name", method["name"]},
                             {"cells",
                              {method["image_psnr_db"], method["dolp_psnr_db"],
                               method["aolp_circular_deg"], method["seconds"]}}});
  return {{"title", title}, {"tables", Json::array({table})}};
}

}  // namespace malus::app
