// Clean light to train on: pieces of pictures, polarized by a random relief, and of scenes that
// were photographed behind four polarizer angles. A piece is a function of (seed, number).
#pragma once

#include "malus/image/view.h"
#include "malus/neural/internal/light_cache.h"
#include "malus/neural/training_config.h"
#include "malus/polar/stokes.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace malus {

/// A folder of pictures I0, I45, I90, I135 (.png, .tif, .exr) of one size: Stokes parameters of its
/// red, green and blue (or its single channel), as fractions of white. Throws InputError.
std::vector<StokesPlanes> load_angle_scene(const std::filesystem::path& folder);

/// A picture's light as unpolarized scene, S1 and S2 empty: R, G, B or one plane, fractions of
/// white. tone: as in TrainingConfig. Throws InputError.
std::vector<StokesPlanes> load_picture_scene(const std::filesystem::path& path,
                                             const std::string& tone);

/// The light of a picture behind two random surfaces, as training sees it: one in its brighter and
/// one in its darker part. A function of (seed, number).
std::vector<StokesPlanes> polarized_picture(const std::vector<StokesPlanes>& light,
                                            std::uint64_t seed, std::uint32_t number);

/// S0 as R, G, B planes, a single one three times: what sites without polarizers see everywhere.
Planes intensity_of(const std::vector<StokesPlanes>& light);

class CleanScenes {
 public:
  /// Of config.pictures and config.scenes. Nothing is loaded yet.
  explicit CleanScenes(const TrainingConfig& config);
  std::size_t size() const { return pictures_.size() + scenes_.size(); }

  /// Three or one StokesPlanes, fractions of white, at most data.example pixels a side and whole
  /// cells of the layout. Cut, enlarged, polarized, mirrored and turned as [data] says. Throws
  /// InputError on pictures that cannot be read or are smaller than a patch. Any thread.
  std::vector<StokesPlanes> draw(std::uint64_t seed, std::uint32_t number) const;

 private:
  using Light = LightCache::Light;
  const std::filesystem::path& path_of(std::size_t index) const;
  std::shared_ptr<const Light> source(std::size_t index) const;
  Light piece_of(const Light& whole, bool picture, std::uint64_t seed, std::uint32_t number) const;

  TrainingDataSettings data_;
  std::string tone_;
  int cell_;  ///< pieces are whole multiples of it
  std::vector<std::filesystem::path> pictures_, scenes_;
  mutable LightCache kept_;  ///< as far as data.memory reaches
};

}  // namespace malus
