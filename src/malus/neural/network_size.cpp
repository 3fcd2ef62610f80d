#include "malus/neural/internal/network_size.h"

#include "malus/base/error.h"

#include <algorithm>
#include <cmath>
#include <string>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace malus {
namespace {

using Json = nlohmann::json;

// A number, or a list of `fewest` to `most` of them.
struct SettingRange {
  const char *architecture, *name;
  double minimum, maximum;
  std::size_t fewest = 1, most = 1;
};

constexpr double kMostChannels = 1024, kMostWidth = 4096, kMostBlocks = 256, kMostHeads = 256,
                 kMostLevels = 8, kMostWindow = 64;
constexpr SettingRange kRanges[] = {
    {"unet", "in_channels", 1, kMostChannels},
    {"unet", "out_channels", 1, kMostChannels},
    {"unet", "width", 1, kMostWidth},
    {"unet", "levels", 1, kMostLevels},
    {"unet", "upscale", 1, 8},
    {"nafnet", "img_channel", 1, kMostChannels},
    {"nafnet", "width", 1, kMostWidth},
    {"nafnet", "middle_blk_num", 1, kMostBlocks},
    {"nafnet", "enc_blk_nums", 0, kMostBlocks, 0, 8},
    {"nafnet", "dec_blk_nums", 0, kMostBlocks, 0, 8},
    {"restormer", "inp_channels", 1, kMostChannels},
    {"restormer", "out_channels", 1, kMostChannels},
    {"restormer", "dim", 1, kMostWidth},
    {"restormer", "num_blocks", 1, kMostBlocks, 4, 4},
    {"restormer", "num_refinement_blocks", 0, kMostBlocks},
    {"restormer", "heads", 1, kMostHeads, 4, 4},
    {"restormer", "ffn_expansion_factor", 0.1, 16},
    {"uformer", "img_size", 1, 65536},
    {"uformer", "in_chans", 1, kMostChannels},
    {"uformer", "dd_in", 1, kMostChannels},
    {"uformer", "embed_dim", 1, kMostWidth},
    {"uformer", "depths", 1, kMostBlocks, 9, 9},
    {"uformer", "num_heads", 1, kMostHeads, 9, 9},
    {"uformer", "win_size", 1, kMostWindow},
    {"malus", "in_channels", 1, kMostChannels},
    {"malus", "out_channels", 1, kMostChannels},
    {"malus", "dim", 1, kMostWidth},
    {"malus", "depths", 1, kMostBlocks, 1, 8},
    {"malus", "heads", 1, kMostHeads, 1, 8},
    {"malus", "window", 1, kMostWindow},
};

[[noreturn]] void refuse_setting(const SettingRange& range, const std::string& problem,
                                 const std::string& remedy) {
  throw InputError(fmt::format("settings of {}", range.architecture),
                   fmt::format("\"{}\" {}", range.name, problem), remedy);
}

void check_value(const SettingRange& range, const Json& value) {
  // The one setting that is no count.
  const bool fraction = std::string_view(range.name) == "ffn_expansion_factor";
  if (!value.is_number() || (!fraction && !value.is_number_integer()) ||
      !(value.get<double>() >= range.minimum && value.get<double>() <= range.maximum))
    refuse_setting(range, fmt::format("is or holds {}", value.dump()),
                   fmt::format("give {} from {} to {}", fraction ? "a number" : "a whole number",
                               range.minimum, range.maximum));
}

double square(double value) { return value * value; }

// Blocks of a stage, and the channels they work on.
struct Stage {
  double blocks, channels;
};

// stages that halve the picture and double the channels, from `first` channels on.
std::vector<Stage> doubling_stages(const std::vector<double>& blocks, double first) {
  std::vector<Stage> stages;
  for (std::size_t i = 0; i < blocks.size(); ++i)
    stages.push_back({blocks[i], std::ldexp(first, static_cast<int>(i))});
  return stages;
}

double squares_of(const std::vector<Stage>& stages) {
  double sum = 0;
  for (const Stage& stage : stages) sum += stage.blocks * square(stage.channels);
  return sum;
}

double block_count_of(const std::vector<Stage>& stages) {
  double sum = 0;
  for (const Stage& stage : stages) sum += stage.blocks;
  return sum;
}

// The second 3x3 convolution of every pair.
double unet_values(const Json& s) {
  const auto levels = s.at("levels").get<std::size_t>();
  const double width = s.at("width");
  return 9 * (squares_of(doubling_stages(std::vector(levels, 1.0), width)) +
              squares_of(doubling_stages(std::vector(levels - 1, 1.0), width)));
}

// 1x1 convolutions: conv1 and conv4 to twice the channels, conv3, sca and conv5 to as many. What
// lifts and lowers the resolution counts for stages without blocks.
double nafnet_values(const Json& s) {
  const std::vector<double> encoders = s.at("enc_blk_nums"), decoders = s.at("dec_blk_nums");
  const double width = s.at("width"), widest = std::ldexp(width, static_cast<int>(encoders.size()));
  return 7 * (squares_of(doubling_stages(encoders, width)) +
              s.at("middle_blk_num").get<double>() * square(widest) +
              squares_of(doubling_stages({decoders.rbegin(), decoders.rend()}, width)));
}

std::vector<Stage> restormer_stages(const Json& s) {
  std::vector<Stage> stages = doubling_stages(s.at("num_blocks"), s.at("dim"));
  for (std::size_t i = stages.size() - 1; i-- > 1;) stages.push_back(stages[i]);
  stages.push_back(
      {stages[0].blocks + s.at("num_refinement_blocks").get<double>(), 2 * stages[0].channels});
  return stages;
}

std::vector<Stage> uformer_stages(const Json& s) {
  const double dim = s.at("embed_dim");
  const std::vector<double> depths = s.at("depths");
  std::vector<Stage> stages = doubling_stages({depths.begin(), depths.begin() + 5}, dim);
  for (std::size_t i = 5; i < depths.size(); ++i)
    stages.push_back({depths[i], std::ldexp(dim, 9 - static_cast<int>(i))});
  return stages;
}

// qkv and the projection, and the three of the gated feed-forward.
double restormer_values(const Json& s) {
  const double factor = s.at("ffn_expansion_factor");
  double sum = 0;
  for (const Stage& stage : restormer_stages(s))
    sum += stage.blocks * stage.channels *
           (4 * stage.channels + 3 * std::floor(stage.channels * factor));
  return sum;
}

// Attention in windows has four matrices, the feed-forward two to and from 4 times the channels;
// and every block has a table of the places in a window.
double uformer_values(const Json& s) {
  const std::vector<Stage> stages = uformer_stages(s);
  return 12 * squares_of(stages) +
         block_count_of(stages) * square(square(s.at("win_size").get<double>()));
}

// Two kinds of attention with four matrices each, the feed-forward to and from twice the channels.
double hybrid_values(const Json& s) {
  const std::vector<double> depths = s.at("depths");
  std::vector<Stage> stages = doubling_stages(depths, s.at("dim"));
  for (std::size_t i = depths.size() - 1; i-- > 0;) stages.push_back(stages[i]);
  return 12 * squares_of(stages) +
         block_count_of(stages) * square(square(s.at("window").get<double>()));
}

void check_heads(const std::string& architecture, const char* name, const Json& heads,
                 const std::vector<Stage>& stages) {
  for (std::size_t i = 0; i < heads.size(); ++i)
    if (std::fmod(stages[i].channels, heads[i].get<double>()) != 0)
      throw InputError(fmt::format("settings of {}", architecture),
                       fmt::format("\"{}\" is {}, and {} channels are not to be shared among {}",
                                   name, heads.dump(), stages[i].channels, heads[i].dump()),
                       "give divisors of every stage's channels");
}

// What settings must be together.
void check_relations(const std::string& architecture, const Json& s) {
  const auto require_as_long = [&](const char* one, const char* other) {
    if (s.at(one).size() != s.at(other).size())
      throw InputError(fmt::format("settings of {}", architecture),
                       fmt::format("\"{}\" and \"{}\" differ in length", one, other),
                       "give a number for every stage");
  };
  const auto require_one_of = [&](const char* name, const std::vector<std::string>& known) {
    if (std::find(known.begin(), known.end(), s.at(name)) == known.end())
      throw InputError(fmt::format("settings of {}", architecture),
                       fmt::format("\"{}\" is {}", name, s.at(name).dump()),
                       fmt::format("give \"{}\"", fmt::join(known, "\" or \"")));
  };
  if (architecture == "nafnet") {
    require_as_long("enc_blk_nums", "dec_blk_nums");
  } else if (architecture == "restormer") {
    check_heads(architecture, "heads", s.at("heads"),
                doubling_stages(s.at("num_blocks"), s.at("dim")));
    require_one_of("LayerNorm_type", {"BiasFree", "WithBias"});
  } else if (architecture == "uformer") {
    // The public implementation's other choices are not here.
    require_one_of("token_projection", {"linear"});
    require_one_of("token_mlp", {"leff"});
    check_heads(architecture, "num_heads", s.at("num_heads"), uformer_stages(s));
  } else if (architecture == "malus") {
    require_as_long("depths", "heads");
    check_heads(architecture, "heads", s.at("heads"), doubling_stages(s.at("depths"), s.at("dim")));
  }
}

}  // namespace

void check_network_settings(const std::string& architecture, const Json& settings) {
  for (const SettingRange& range : kRanges) {
    if (architecture != range.architecture) continue;
    const Json& value = settings.at(range.name);
    if (!value.is_array()) {
      check_value(range, value);
      continue;
    }
    if (value.size() < range.fewest || value.size() > range.most)
      refuse_setting(range, fmt::format("has {} numbers", value.size()),
                     range.fewest == range.most
                         ? fmt::format("give {}", range.most)
                         : fmt::format("give {} to {}", range.fewest, range.most));
    for (const Json& one : value) check_value(range, one);
  }
  check_relations(architecture, settings);
}

double least_network_values(const std::string& architecture, const Json& settings) {
  if (architecture == "unet") return unet_values(settings);
  if (architecture == "nafnet") return nafnet_values(settings);
  if (architecture == "restormer") return restormer_values(settings);
  if (architecture == "uformer") return uformer_values(settings);
  MALUS_REQUIRE(architecture == "malus");
  return hybrid_values(settings);
}

}  // namespace malus
