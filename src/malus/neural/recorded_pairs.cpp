#include "malus/neural/internal/recorded_pairs.h"

#include "malus/base/error.h"
#include "malus/base/fingerprint.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/base/unreadable_file.h"
#include "malus/denoise/column_noise.h"
#include "malus/image/pack.h"
#include "malus/image/window.h"
#include "malus/io/frame_file.h"
#include "malus/io/gain_json.h"
#include "malus/io/pair_list.h"
#include "malus/io/picture_file.h"
#include "malus/io/shard_read.h"
#include "malus/neural/internal/camera_noise.h"
#include "malus/neural/noise_flow_file.h"
#include "malus/noise/fixed_pattern.h"
#include "malus/noise/frame_levels.h"
#include "malus/noise/same_sensor.h"
#include "malus/noise/sensor_window.h"
#include "malus/synthesize/dataset.h"
#include "malus/synthesize/pairs.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <numeric>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;
namespace fs = std::filesystem;

const fs::path& only_model(const TrainingConfig& config) {
  if (config.models.size() != 1)
    throw InputError(config.source.string(),
                     fmt::format("names {} noise models", config.models.size()),
                     "name the one that describes the recorded pairs");
  return config.models.front();
}

// What drew the samples of shards is described, not drawn again: their own dataset.json holds the
// settings that it was drawn with.
std::unique_ptr<const CameraNoise> camera_of_shards(const TrainingConfig& config) {
  CameraNoiseOptions options;
  options.settings.extrapolate_gain = config.synthesis.extrapolate_gain;
  return open_camera(only_model(config), config.package, options);
}

Json load_json(const fs::path& path) {
  std::ifstream in(path);
  if (!in) throw unreadable_file(path);
  try {
    return Json::parse(in);
  } catch (const Json::exception& error) {
    throw InputError(path.string(), fmt::format("is not JSON ({})", error.what()),
                     "give what malus wrote");
  }
}

double checked_ratio(const Json& facts, const std::string& source) {
  const double ratio = facts.at("ratio").get<double>();
  if (!std::isfinite(ratio) || ratio <= 0)
    throw InputError(source, fmt::format("has the low-light ratio {}", ratio),
                     "a ratio is above 0");
  return ratio;
}

// In DN, which pixels hold as floats.
double checked_bias(const Json& facts, const std::string& source) {
  const double bias_dn = facts.at("removed_bias_dn").get<double>();
  if (!(std::abs(bias_dn) <= std::numeric_limits<float>::max()))
    throw InputError(source, fmt::format("removed_bias_dn is {:g}", bias_dn),
                     "make the shard again with malus dataset");
  return bias_dn;
}

// Planes in other places, or noise that the model does not describe, would train a network without
// a word.
void require_drawn_from(const NoiseModel& model, const Json& dataset, const fs::path& file) {
  const auto layout = dataset.at("layout").get<std::string>();
  if (layout != model.layout.name() ||
      dataset.at("channels").get<std::vector<std::string>>() != model.layout.channel_names())
    throw InputError(
        file.string(),
        fmt::format("its shards have the layout {}, the package {}", layout, model.layout.name()),
        "name shards of the package's layout");
  if (const auto sensor = dataset.at("sensor").get<std::string>(); sensor != model.sensor)
    throw InputError(
        file.string(),
        fmt::format("its shards were drawn from a model of the sensor \"{}\", models names "
                    "one of \"{}\"",
                    sensor, model.sensor),
        "name the noise model that they were drawn from");
}

// As dataset.json has it; null: built in.
Json fingerprint_of_model(const fs::path& path) {
  return fs::exists(path) ? Json(file_fingerprint(path)) : Json();
}

// Two calibrations may have one sensor's name, or none. Of a flow the name tells its weights.
std::string complaint_of_model(const NoiseModel& model, const fs::path& path, const Json& print,
                               const Json& dataset, const fs::path& file) {
  if (names_noise_flow(path) || print == dataset.value("model_fingerprint", print)) return {};
  if (model.sensor.empty())
    throw InputError(
        file.string(),
        fmt::format("its shards were drawn from another noise model than {}, and neither names "
                    "its sensor",
                    path.string()),
        "name the noise model that they were drawn from");
  return fmt::format(
      "{}: its shards were drawn from another noise model of the sensor \"{}\" than {}, by which "
      "the network is told their noise",
      file.string(), model.sensor, path.string());
}

// The settings that the samples were drawn with; a flow's tell no parts.
PhysicsParts parts_of_shards(const Json& noise) {
  return {.shot = noise.value("shot", true),
          .read = noise.value("read", true),
          .row = noise.value("row", true),
          .quantization = noise.value("quantization", true),
          .bias = noise.value("bias", true)};
}

// Where examples are cut out of larger mosaics: at whole cells and row groups, no larger than
// `side`.
class ExampleWindows {
 public:
  ExampleWindows(const NoiseModel& model, int side)
      : cell_(std::lcm(std::lcm(model.layout.rows(), model.layout.cols()), model.row_group)),
        side_(side) {}
  MosaicWindow draw(const Image& mosaic, RandomSequence& random) const {
    const int rows = std::min(mosaic.rows(), side_) / cell_ * cell_;
    const int cols = std::min(mosaic.cols(), side_) / cell_ * cell_;
    const auto start = [&](int size, int length) {
      return cell_ *
             static_cast<int>(pick(random, static_cast<std::size_t>((size - length) / cell_ + 1)));
    };
    const int row0 = start(mosaic.rows(), rows), col0 = start(mosaic.cols(), cols);
    return {row0, col0, rows, cols};
  }

 private:
  int cell_, side_;
};

class ShardPairs final : public PairSource {
 public:
  explicit ShardPairs(const TrainingConfig& config)
      : noise_(camera_of_shards(config)),
        model_(noise_->camera()),
        windows_(model_, config.data.example) {
    const Json print = fingerprint_of_model(config.models.front());
    for (const fs::path& path : config.shards) {
      const fs::path file = path.parent_path() / "dataset.json";
      const Json dataset = load_json(file);
      require_drawn_from(model_, dataset, file);
      if (std::string line =
              complaint_of_model(model_, config.models.front(), print, dataset, file);
          !line.empty() && std::ranges::find(complaints_, line) == complaints_.end())
        complaints_.push_back(std::move(line));
      const Json& noise = dataset.at("noise");
      const bool amplified = noise.at("amplify").get<bool>();
      const PhysicsParts parts = parts_of_shards(noise);
      require_noise_level(parts, model_.quantization_dn, config.package, file.string());
      const auto entries = shard_entries(path);
      for (std::size_t i = 0; i + 2 < entries.size(); i += 3)
        samples_.push_back({path, entries[i], entries[i + 1], entries[i + 2], amplified, parts});
    }
    if (samples_.empty())
      throw InputError(config.source.string(), "its shards hold no samples",
                       "make them with malus dataset");
  }

  RawPair pair(std::uint64_t seed, std::uint32_t number) const override {
    RandomSequence random(seed, number, Draw::kScene, kStreamShardSample);
    const Sample& sample = samples_[pick(random, samples_.size())];
    const std::string where = fmt::format("{} ({})", sample.path.string(), sample.facts.name);
    RawPair pair;
    double removed_bias_dn = 0;
    try {
      const Json facts = Json::parse(shard_content(sample.path, sample.facts));
      pair.ratio = checked_ratio(facts, where);
      removed_bias_dn = checked_bias(facts, where);
      pair.profile = noise_->profile_at(checked_gain_from(facts, where), sample.parts);
    } catch (const Json::exception& error) {
      throw InputError(where, fmt::format("cannot be read ({})", error.what()),
                       "make the shard again with malus dataset");
    }
    const Image clean = mosaic(sample, sample.clean), noisy = mosaic(sample, sample.noisy);
    if (noisy.rows() != clean.rows() || noisy.cols() != clean.cols())
      throw InputError(where, "its noisy planes have another size than its clean ones",
                       "make the shard again with malus dataset");
    const MosaicWindow part = windows_.draw(clean, random);
    pair.clean_dn = part_of(clean, part);
    pair.noisy.dn = part_of(noisy, part);
    const auto scale = static_cast<float>(sample.amplified ? 1.0 / pair.ratio : 1.0);
    for (Image* image : {&pair.clean_dn, &pair.noisy.dn})
      for (float& v : image->values()) v *= scale;
    for (const Image* image : {&pair.clean_dn, &pair.noisy.dn}) require_finite(*image, where);
    pair.noisy.layout = model_.layout;
    pair.noisy.source = where;
    // The sample's zero lies where debias put it; white stays as far above it as it was.
    pair.noisy.black_dn.assign(pair.profile.channels.size(), -removed_bias_dn);
    pair.noisy.white_dn = white_above_black(model_.white_dn, model_.black_dn) - removed_bias_dn;
    pair.noisy.white_known = true;
    return pair;
  }

  std::size_t size() const override { return samples_.size(); }
  std::vector<std::string> complaints() const override { return complaints_; }

 private:
  struct Sample {
    fs::path path;
    ShardEntry clean, noisy, facts;
    bool amplified;
    PhysicsParts parts;
  };
  Image mosaic(const Sample& sample, const ShardEntry& entry) const {
    const Planes planes = planes_of_npy(shard_content(sample.path, entry), entry.name);
    if (planes.channels() != model_.layout.channels())
      throw InputError(sample.path.string(),
                       fmt::format("holds {} planes per sample", planes.channels()),
                       "name the noise model that it was made with");
    Image out(planes.rows() * model_.layout.rows(), planes.cols() * model_.layout.cols());
    unpack(planes, model_.layout, out);
    return out;
  }

  std::unique_ptr<const CameraNoise> noise_;
  const NoiseModel& model_;
  ExampleWindows windows_;
  std::vector<Sample> samples_;
  std::vector<std::string> complaints_;
};

class CapturedPairs final : public PairSource {
 public:
  explicit CapturedPairs(const TrainingConfig& config)
      : model_(load_camera(only_model(config), config.package, "captured pairs")),
        path_(config.models.front()),
        gains_(gain_range(config.synthesis.extrapolate_gain)),
        windows_(model_, config.data.example),
        with_picture_(config.package.gives_picture()),
        displayed_(config.package.settings.gives() == NetworkTarget::kSrgb) {
    KnownGains known(model_, gains_);
    for (const fs::path& path : config.pairs)
      for (RecordedPair& pair : load_pair_list(path)) {
        for (const GainSetting& gain : {pair.gain, pair.bias_at.value_or(pair.gain)})
          known.require(gain, fmt::format("{}: {}", path.string(), pair.name));
        pairs_.push_back(std::move(pair));
      }
    if (pairs_.empty())
      throw InputError(config.source.string(), "its pairs are none", "make them with malus pairs");
  }

  RawPair pair(std::uint64_t seed, std::uint32_t number) const override {
    RandomSequence random(seed, number, Draw::kScene, kStreamRecordedPair);
    const RecordedPair& recorded = pairs_[pick(random, pairs_.size())];
    RawPair pair;
    pair.noisy = load_of_sensor(recorded.noisy);
    const std::vector<Image> clean = clean_planes(recorded, pair.noisy);
    const MosaicWindow part = windows_.draw(clean.front(), random);
    pair.noisy.dn = part_of(pair.noisy.dn, part);
    require_finite(pair.noisy.dn, recorded.noisy.string());
    pair.clean_dn = part_of(clean.front(), part);
    if (clean.size() > 1) pair.clean_rgb_dn = Planes(3, 0, 0);
    for (int k = 0; k < pair.clean_rgb_dn.channels(); ++k)
      pair.clean_rgb_dn[k] = part_of(clean[static_cast<std::size_t>(k) + 1], part);
    pair.profile = denoising_profile(pair.noisy, model_, recorded.gain, gains_);
    add_dark_pattern(pair.profile, recorded);
    cut_defects(pair.profile, clean.front(), part);
    pair.ratio = recorded.ratio;
    return pair;
  }

  std::size_t size() const override { return pairs_.size(); }

  std::vector<std::string> complaints() const override {
    std::vector<GainSetting> gains;
    for (const RecordedPair& pair : pairs_) gains.push_back(pair.gain);
    const std::string line = untold_gain_complaint(model_, gains);
    if (line.empty()) return {};
    return {path_.string() + ": " + line};
  }

 private:
  // The reference is of the same pixels. What they make of light is in both alike, no noise between
  // the two; of their dark signal the clean picture holds what the reference's gain made of it,
  // over the ratio.
  void add_dark_pattern(NoiseProfile& profile, const RecordedPair& recorded) const {
    const double held = reference_gain_ratio(profile, recorded) / recorded.ratio;
    std::vector<PatternDeviation> left = pattern_deviations_at(model_, recorded.gain, profile);
    for (PatternDeviation& d : left) d = {0, d.dsnu_dn * std::abs(1 - held)};
    add_pattern_noise(profile, left);
  }

  // K of the reference over that of the short frame, whose profile this is; by the decibels where
  // the model does not know the reference's gain, which nothing else asks it for.
  double reference_gain_ratio(const NoiseProfile& profile, const RecordedPair& recorded) const {
    if (!recorded.reference_gain || *recorded.reference_gain == recorded.gain) return 1;
    try {
      if (const auto by_model =
              gain_ratio(model_.profile_at(*recorded.reference_gain, gains_), profile))
        return *by_model;
    } catch (const InputError&) {
    }
    return gain_ratio(*recorded.reference_gain, recorded.gain);
  }

  // Those of the piece, which preparation fills in it as in a whole frame.
  static void cut_defects(NoiseProfile& profile, const Image& whole, const MosaicWindow& part) {
    if (profile.defects.rows == whole.rows() && profile.defects.cols == whole.cols())
      cut_to_window(profile, {part.row0, part.col0}, part.rows, part.cols, "a piece of a pair");
    else
      profile.defects = {};
  }

  RawFrame load_of_sensor(const fs::path& path) const {
    RawFrame frame = load_frame(path);
    take_layout_of_model(frame, model_.layout);
    return frame;
  }

  // The mosaic, and after it the colours of a pair that has them where the network gives a picture,
  // at the noisy frame's light. What they do not tell of it is NaN.
  std::vector<Image> clean_planes(const RecordedPair& recorded, const RawFrame& noisy) const {
    RawFrame reference = load_of_sensor(recorded.reference);
    const double white_dn = displayed_ ? std::numeric_limits<double>::infinity()
                                       : white_of_reference(reference, noisy, model_);
    const DefectList defects =
        model_.defects.empty() ? DefectList{} : model_.profile_at(recorded.gain, gains_).defects;
    const auto checked = [&](Image plane, const fs::path& file) {
      if (plane.rows() != noisy.dn.rows() || plane.cols() != noisy.dn.cols())
        throw InputError(recorded.noisy.string(), "has another size than its reference",
                         "make the pairs again");
      require_finite(plane, file.string());
      if (mark_unknown(plane, white_dn, defects) == static_cast<std::int64_t>(plane.size()))
        throw InputError(file.string(), "tells no light: all of its pixels are at white",
                         "expose the reference below white, or leave the pair out");
      return plane;
    };
    std::vector<Image> planes{
        light_of_reference(checked(std::move(reference.dn), recorded.reference), recorded.ratio,
                           &model_, recorded.bias_at, gains_)};
    if (with_picture_ && !recorded.picture.empty())
      for (Image& plane : load_colors(recorded))
        planes.push_back(
            light_of_reference(checked(std::move(plane), recorded.picture), recorded.ratio));
    return planes;
  }

  NoiseModel model_;
  fs::path path_;  ///< of the model
  GainRange gains_;
  ExampleWindows windows_;
  bool with_picture_;
  bool displayed_;  ///< where the display's white is white, whatever light is above it
  std::vector<RecordedPair> pairs_;
};

template <class Source>
std::unique_ptr<PairSource> opened(const TrainingConfig& config) {
  try {
    return std::make_unique<Source>(config);
  } catch (const Json::exception& error) {
    throw InputError(config.source.string(),
                     fmt::format("its recorded pairs cannot be read ({})", error.what()),
                     "make them with malus dataset or malus pairs");
  }
}

}  // namespace

std::unique_ptr<PairSource> open_shards(const TrainingConfig& config) {
  return opened<ShardPairs>(config);
}

std::unique_ptr<PairSource> open_captured_pairs(const TrainingConfig& config) {
  return opened<CapturedPairs>(config);
}

}  // namespace malus
