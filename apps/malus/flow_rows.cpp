#include "flow_rows.h"

#include "malus/base/error.h"
#include "malus/io/shard.h"

#include <cstdint>

#include "captures.h"
#include "networks_door.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

// Seeds of captures: apart from those of the captures that are scored on.
constexpr std::uint64_t kFirstSeed = 1000;

// Those of the row's training.
std::vector<fs::path> pictures_of(const TableRow& row, const Common& common) {
  const ConfigSection root =
      ConfigSection::load(row.config, "the training configuration", common.settings);
  std::vector<fs::path> pictures;
  if (const auto data = root.section("data"))
    for (const std::string& pattern : data->texts("pictures"))
      for (fs::path& found : files_matching(row.config.parent_path(), pattern))
        pictures.push_back(std::move(found));
  if (pictures.empty())
    root.fail("data.pictures", "name no picture that the camera could take for the Noise Flow",
              "name some, or give captured pairs with --flow-pairs");
  return pictures;
}

fs::path take_flow_captures(const TableRow& row, const FlowCaptures& captures,
                            const NoiseModel& camera, const fs::path& folder, const Common& common,
                            Progress& progress) {
  const std::vector<fs::path> pictures = pictures_of(row, common);
  std::vector<RecordedPair> pairs;
  for (const GainSetting& gain : captures.gains)
    for (const double ratio : kFlowRatios) {
      const std::size_t number = pairs.size();
      const CameraShot shot{
          .gain = gain, .ratio = ratio, .exposure = captures.exposure, .crop = captures.crop};
      for (RecordedPair& pair :
           take_pictures(camera, {pictures[number % pictures.size()]}, shot,
                         folder / "flow-captures" / fmt::format("{:03}", number),
                         common.seed + kFirstSeed + number, progress))
        pairs.push_back(std::move(pair));
    }
  const fs::path list = folder / "flow-captures" / "pairs.json";
  save_pair_list(pairs, list);
  return list;
}

}  // namespace

void check_flow(const TableRow& row, const FlowCaptures& captures, const Common& common) {
  const ConfigSection root = ConfigSection::load(row.noise_flow, "the Noise Flow's configuration");
  const auto network = root.section("network");
  if (!network || network->text("architecture") != kNoiseFlowArchitecture)
    throw InputError(row.noise_flow.string(), "is no configuration of a Noise Flow",
                     "give one with architecture = \"noise-flow\" in [network]");
  if (captures.pairs.empty())
    pictures_of(row, common);
  else
    load_pair_list(captures.pairs);
}

fs::path trained_flow(const TableRow& row, const FlowCaptures& captures, const NoiseModel& camera,
                      const fs::path& folder, const Common& common, Progress& progress) {
  const fs::path pairs = captures.pairs.empty()
                             ? take_flow_captures(row, captures, camera, folder, common, progress)
                             : captures.pairs;
  note(common, "training the Noise Flow of " + row.name);
  return networks()
      .train({.config = row.noise_flow,
              .folder = folder / row.noise_flow.stem(),
              .resume = true,
              .force = common.force,
              .seed = common.seed,
              .pairs = {pairs},
              .models = {captures.model}},
             progress)
      .at("weights")
      .get<std::string>();
}

}  // namespace malus::app
