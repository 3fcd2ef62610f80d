// pairs.json: the list of captured pairs that `malus pairs` writes beside their frames; training
// and experiments read it.
#pragma once

#include "malus/image/raw_frame.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace malus {

/// One entry: a noisy frame and the clean mosaic of its scene.
struct RecordedPair {
  std::string name;                 ///< "scene003_01": the second noisy frame of scene003
  std::filesystem::path noisy;      ///< as the camera wrote it, black included
  std::filesystem::path reference;  ///< DN above black, at its own light
  std::filesystem::path picture;    ///< the reference's light as R, G, B; may be empty
  double ratio = 1;                 ///< light of the reference over that of the noisy frame
  GainSetting gain;                 ///< of the noisy frame
  /// Gain of the reference, where that still holds the sensor's bias; empty where it holds none,
  /// and where a list does not say, as those from before 2026-11-27.
  std::optional<GainSetting> bias_at = std::nullopt;
  /// Gain of the reference; empty where a list does not say.
  std::optional<GainSetting> reference_gain = std::nullopt;
  std::string scene() const;  ///< the name without its last part: "scene003"
};

/// Paths are relative to the list's folder. Throws InputError on a file that is no such list, or
/// holds a ratio that is not above 0, a gain that no camera has or one file as both of a pair.
std::vector<RecordedPair> load_pair_list(const std::filesystem::path& list);

/// A pair's picture, which it must have. Throws InputError where it cannot be read or has not three
/// planes.
Planes load_colors(const RecordedPair& pair);

/// Replaces an old list; paths are written absolute. Throws InputError.
void save_pair_list(const std::vector<RecordedPair>& pairs, const std::filesystem::path& list);

}  // namespace malus
