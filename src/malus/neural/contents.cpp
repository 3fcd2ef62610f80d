#include "malus/neural/internal/contents.h"

#include "malus/base/error.h"
#include "malus/base/fingerprint.h"
#include "malus/base/unreadable_file.h"
#include "malus/io/angle_pictures.h"
#include "malus/io/frame_stack.h"
#include "malus/io/pair_list.h"

#include <algorithm>
#include <fstream>
#include <string_view>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

constexpr std::uint64_t kEnd = 1 << 16;  // bytes

enum class Extent { kWhole, kEnds };

class Hash : public Fingerprint {
 public:
  void add_file(const fs::path& path, Extent extent) {
    std::error_code error;
    const std::uint64_t size = fs::file_size(path, error);
    std::ifstream in(path, std::ios::binary);
    if (error || !in) refuse(path);
    add(fmt::format("{} bytes", size));
    if (extent == Extent::kEnds && size > 2 * kEnd) {
      add_next(in, kEnd);
      in.seekg(static_cast<std::streamoff>(size - kEnd));
      add_next(in, kEnd);
    } else {
      add_next(in, size);
    }
    if (!in) refuse(path);
  }

  // A file, or one frame of a stack.
  void add_frame(const fs::path& path) {
    const FramePlace place = frame_place(path);
    add_file(place.file, Extent::kEnds);
    if (place.index) add(fmt::format("frame {}", *place.index));
  }

 private:
  [[noreturn]] static void refuse(const fs::path& path) { throw unreadable_file(path); }
  void add_next(std::ifstream& in, std::uint64_t bytes) {
    for (std::string part; bytes > 0 && in; bytes -= part.size()) {
      part.resize(std::min(bytes, kEnd));
      in.read(part.data(), static_cast<std::streamsize>(part.size()));
      add(part);
    }
  }
};

void add_model(Hash& hash, const fs::path& path) {
  if (fs::is_regular_file(path))
    hash.add_file(path, Extent::kWhole);
  else
    hash.add(path.string());  // a built-in one
}

void add_scene(Hash& hash, const fs::path& path) {
  if (!fs::is_directory(path)) return hash.add_file(path, Extent::kEnds);
  for (const fs::path& angle : angle_picture_files(path)) hash.add_file(angle, Extent::kEnds);
}

void add_pairs(Hash& hash, const fs::path& list) {
  for (const RecordedPair& pair : load_pair_list(list)) {
    hash.add(fmt::format("{} {}", pair.ratio, pair.gain.text()));
    if (pair.bias_at) hash.add("with the bias at " + pair.bias_at->text());
    if (pair.reference_gain.value_or(pair.gain) != pair.gain)
      hash.add("of a reference at " + pair.reference_gain->text());
    for (const fs::path& path : {pair.noisy, pair.reference, pair.picture})
      if (!path.empty()) hash.add_frame(path);
  }
}

}  // namespace

Json contents_json(const TrainingConfig& config) {
  Json json = Json::object();
  const auto add = [&](const char* kind, const std::vector<fs::path>& paths, const auto& add_one) {
    if (paths.empty()) return;
    Hash hash;
    for (const fs::path& path : paths) add_one(hash, path);
    json[kind] = hash.text();
  };
  const auto add_data = [](Hash& hash, const fs::path& path) {
    hash.add_file(path, Extent::kEnds);
  };
  add("models", config.models, add_model);
  add("shards", config.shards, add_data);
  add("pairs", config.pairs, add_pairs);
  add("pictures", config.pictures, add_data);
  add("scenes", config.scenes, add_scene);
  add("validation_scenes", config.validation_scenes, add_scene);
  if (!config.begin_with.empty()) add("begin_with", {config.begin_with}, add_data);
  return json;
}

std::string contents_of(const std::vector<fs::path>& files) {
  Hash hash;
  for (const fs::path& path : files) hash.add_frame(path);
  return hash.text();
}

std::string contents_of_model(const fs::path& model) {
  Hash hash;
  add_model(hash, model);
  return hash.text();
}

}  // namespace malus
