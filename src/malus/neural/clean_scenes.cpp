#include "malus/neural/internal/clean_scenes.h"

#include "malus/base/error.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/io/angle_pictures.h"
#include "malus/neural/internal/raw_pairs.h"
#include "malus/polar/symmetry.h"
#include "malus/synthesize/dataset.h"
#include "malus/synthesize/scene.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

// Surfaces of the reliefs (synthesize/scene.h): wide, so that networks see every polarization.
constexpr double kReliefLow = 15, kReliefHigh = 85, kIndexLow = 1.3, kIndexHigh = 2.0;
constexpr double kBumpsLow = 2, kBumpsHigh = 60;
// Real surfaces are rough: of every other one a part of the polarization is left. Most of a real
// scene is polarized by a few per cent, some of it strongly.
constexpr double kPolarizedLow = 0.03;
// One surface in four is a film instead; films as they are before a screen and in daylight.
constexpr double kFilms = 0.25, kFilmPolarizedLow = 0.2, kFilmWavesHigh = 3;
// Enlarged pieces are interpolated, and softer than any camera's picture. Networks that saw no
// others lost 1 to 4 dB on print and on bars of whole pixels, which their guide knew.
constexpr double kAsItIs = 0.5;
// Where the brighter surface begins, in means of the picture.
constexpr double kEdgeLow = 0.5, kEdgeHigh = 1.5;

double between(RandomSequence& random, double low, double high) {
  return low + (high - low) * random.uniform();
}

// The rectangle at (row0, col0) in steps of 1/zoom, interpolated linearly.
Image cut(const Image& from, double row0, double col0, double zoom, int rows, int cols) {
  Image out(rows, cols);
  if (from.empty()) return out;
  for (int r = 0; r < rows; ++r) {
    const double y = row0 + r / zoom;
    const int i = std::clamp(static_cast<int>(y), 0, from.rows() - 1);
    const int below = std::min(i + 1, from.rows() - 1);
    const auto v = static_cast<float>(y - i);
    for (int c = 0; c < cols; ++c) {
      const double x = col0 + c / zoom;
      const int k = std::clamp(static_cast<int>(x), 0, from.cols() - 1);
      const int right = std::min(k + 1, from.cols() - 1);
      const auto u = static_cast<float>(x - k);
      out(r, c) = (1 - v) * ((1 - u) * from(i, k) + u * from(i, right)) +
                  v * ((1 - u) * from(below, k) + u * from(below, right));
    }
  }
  return out;
}

int random_bumps(RandomSequence& random) {
  return static_cast<int>(kBumpsLow * std::pow(kBumpsHigh / kBumpsLow, random.uniform()));
}

SceneSettings random_surface(RandomSequence& random) {
  SceneSettings settings;
  settings.relief_deg = between(random, kReliefLow, kReliefHigh);
  settings.index = between(random, kIndexLow, kIndexHigh);
  settings.gloss = random.uniform();
  settings.bumps = random_bumps(random);
  return settings;
}

FilmSettings random_film(RandomSequence& random) {
  FilmSettings settings;
  settings.polarized = between(random, kFilmPolarizedLow, 1);
  settings.angle_deg = between(random, 0, 180);
  settings.retardance_waves = kFilmWavesHigh * random.uniform();
  settings.turn_deg = between(random, 0, 180);
  settings.bumps = random_bumps(random);
  return settings;
}

void depolarize(std::vector<StokesPlanes>& light, RandomSequence& random) {
  const double drawn = random.uniform(), left = std::pow(kPolarizedLow, random.uniform());
  if (drawn < 0.5) return;
  for (StokesPlanes& color : light)
    for (Image* image : {&color.s1, &color.s2})
      for (float& v : image->values()) v *= static_cast<float>(left);
}

// A film before polarized light, or a surface with a relief.
std::vector<StokesPlanes> random_polarization(const Planes& light, RandomSequence& random,
                                              std::uint64_t seed, std::uint32_t number) {
  if (random.uniform() < kFilms) return film_scene(light, random_film(random), seed, number);
  std::vector<StokesPlanes> stokes =
      std::move(polarized_scene(light, random_surface(random), seed, number).stokes);
  depolarize(stokes, random);
  return stokes;
}

// Two of them, in the brighter and the darker part of the picture: polarization changes where the
// picture has its edges.
std::vector<StokesPlanes> polarized(const Planes& light, RandomSequence& random, std::uint64_t seed,
                                    std::uint32_t number) {
  std::vector<StokesPlanes> bright = random_polarization(light, random, seed, number);
  const std::vector<StokesPlanes> dark = random_polarization(light, random, seed + 1, number);
  const Image& guide = light[light.channels() / 2];
  double mean = 0;
  for (const float v : guide.values()) mean += static_cast<double>(v);
  const double edge =
      between(random, kEdgeLow, kEdgeHigh) * mean / static_cast<double>(guide.size());
  for (std::size_t k = 0; k < bright.size(); ++k)
    for (std::size_t i = 0; i < guide.size(); ++i) {
      if (static_cast<double>(guide.values()[i]) >= edge) continue;
      bright[k].s0.values()[i] = dark[k].s0.values()[i];
      bright[k].s1.values()[i] = dark[k].s1.values()[i];
      bright[k].s2.values()[i] = dark[k].s2.values()[i];
    }
  return bright;
}

Planes brightness_of(const std::vector<StokesPlanes>& light) {
  Planes planes(static_cast<int>(light.size()), 0, 0);
  for (std::size_t k = 0; k < light.size(); ++k) planes[static_cast<int>(k)] = light[k].s0;
  return planes;
}

}  // namespace

std::vector<StokesPlanes> polarized_picture(const std::vector<StokesPlanes>& light,
                                            std::uint64_t seed, std::uint32_t number) {
  RandomSequence random(seed, number, Draw::kScene, kStreamPiece);
  return polarized(brightness_of(light), random, seed, number);
}

std::vector<StokesPlanes> load_angle_scene(const fs::path& folder) {
  std::array<Planes, 4> angles;
  std::size_t next = 0;
  for (const Picture& picture : load_angle_pictures(folder)) {
    for (const Image& plane : picture.planes)
      require_finite(plane, (folder / fmt::format("I{}", 45 * next)).string());
    angles[next++] = linear_light(picture.planes, picture.names, picture.white, false);
  }
  std::vector<StokesPlanes> stokes;
  for (int c = 0; c < angles[0].channels(); ++c)
    stokes.push_back(stokes_of({angles[0][c], angles[1][c], angles[2][c], angles[3][c]}));
  return stokes;
}

std::vector<StokesPlanes> load_picture_scene(const fs::path& path, const std::string& tone) {
  const Picture picture = load_clean_picture(path);
  for (const Image& plane : picture.planes) require_finite(plane, path.string());
  const Planes linear =
      linear_light(picture.planes, picture.names, picture.white, is_srgb(tone, picture.bits));
  std::vector<StokesPlanes> light;
  for (const Image& plane : linear) light.push_back({plane, Image(), Image()});
  return light;
}

Planes intensity_of(const std::vector<StokesPlanes>& light) {
  Planes rgb(3, 0, 0);
  for (int color = 0; color < 3; ++color)
    rgb[color] = light[light.size() == 3 ? static_cast<std::size_t>(color) : 0].s0;
  return rgb;
}

CleanScenes::CleanScenes(const TrainingConfig& config)
    : data_(config.data),
      tone_(config.tone),
      cell_(std::lcm(std::lcm(config.package.layout().rows(), config.package.layout().cols()), 2)),
      pictures_(config.pictures),
      scenes_(config.scenes),
      kept_(config.data.memory_mib) {}

const fs::path& CleanScenes::path_of(std::size_t index) const {
  return index < pictures_.size() ? pictures_[index] : scenes_[index - pictures_.size()];
}

std::shared_ptr<const CleanScenes::Light> CleanScenes::source(std::size_t index) const {
  const fs::path& path = path_of(index);
  return kept_.light(path, [&] {
    return index < pictures_.size() ? load_picture_scene(path, tone_) : load_angle_scene(path);
  });
}

CleanScenes::Light CleanScenes::piece_of(const Light& whole, bool picture, std::uint64_t seed,
                                         std::uint32_t number) const {
  RandomSequence random(seed, number, Draw::kScene, kStreamPiece);
  const double drawn_zoom = std::pow(data_.zoom, random.uniform());
  const bool as_it_is = data_.zoom == 1 || random.uniform() < kAsItIs;
  const double zoom = as_it_is ? 1 : drawn_zoom;
  const auto side = [&](int size) {
    return std::min(static_cast<int>((size - 1) * zoom), data_.example) / cell_ * cell_;
  };
  const int rows = side(whole[0].s0.rows()), cols = side(whole[0].s0.cols());
  const double row0 = between(random, 0, whole[0].s0.rows() - 1 - rows / zoom);
  const double col0 = between(random, 0, whole[0].s0.cols() - 1 - cols / zoom);
  const auto start = [&](double position) { return as_it_is ? std::floor(position) : position; };
  const auto cut_out = [&](const Image& plane) {
    return cut(plane, std::max(start(row0), 0.0), std::max(start(col0), 0.0), zoom, rows, cols);
  };
  Light piece;
  for (const StokesPlanes& color : whole)
    piece.push_back({cut_out(color.s0), cut_out(color.s1), cut_out(color.s2)});
  if (!picture || !data_.polarized) return piece;
  return polarized(brightness_of(piece), random, seed, number);
}

std::vector<StokesPlanes> CleanScenes::draw(std::uint64_t seed, std::uint32_t number) const {
  RandomSequence random(seed, number, Draw::kScene, kStreamCleanScene);
  const std::size_t index = pick(random, size());
  const Symmetry symmetry = kSymmetries[pick(random, kSymmetries.size())].symmetry;
  const auto whole = source(index);
  if (std::min(whole->front().s0.rows(), whole->front().s0.cols()) <= data_.patch)
    throw InputError(path_of(index).string(),
                     fmt::format("of {} x {} pixels is not larger than a patch of {}",
                                 whole->front().s0.cols(), whole->front().s0.rows(), data_.patch),
                     "use larger pictures or a smaller patch");
  Light piece = piece_of(*whole, index < pictures_.size(), seed, number);
  if (data_.symmetries)
    for (StokesPlanes& color : piece) color = transformed(color, symmetry);
  return piece;
}

}  // namespace malus
