#include "malus/neural/inference.h"

#include "malus/base/error.h"
#include "malus/base/stopwatch.h"
#include "malus/base/wording.h"
#include "malus/image/pack.h"
#include "malus/neural/gpu.h"
#include "malus/neural/internal/autocast.h"
#include "malus/neural/internal/packed.h"
#include "malus/neural/internal/tiles.h"
#include "malus/neural/internal/trained_light.h"
#include "malus/neural/package.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include <fmt/format.h>

namespace malus {
namespace {

using OrderedJson = nlohmann::ordered_json;

// Memory beside the tiles, in frames: the frame, its guide, the network's planes, the result.
constexpr double kMosaicFrames = 4, kPictureFrames = 8;

// On a CPU the kernels of the forward pass round what they multiply; where that would cost time, or
// libtorch's layers run, the run stays with float32. On a GPU it is libtorch's autocast.
bool takes_bfloat16(const std::string& architecture, const std::string& device,
                    const TileDemand& demand) {
  if (device == "cpu") return demand.own_kernels && internal::rounded_products_pay();
  if (!autocast_suits(architecture))
    throw InputError(setting("precision", "bfloat16"),
                     fmt::format("is not offered for {} on {}", architecture, device),
                     "leave it out: float32");
  return true;
}

// First and last + 1 row (or column) of the frame in a span of cells; the frame begins `phase`
// pixels inside the first.
std::pair<int, int> pixels_of(const TileSpan& cells, int cell, int phase, int frame) {
  return {std::max(static_cast<int>(cells.begin) * cell - phase, 0),
          std::min(static_cast<int>(cells.end) * cell - phase, frame)};
}

// Tiles of a picture that fit into the memory beside what else is held.
TileCore core_within(double memory_mib, double held_bytes, std::int64_t rows, std::int64_t cols,
                     int batch, const TileDemand& demand) {
  const TileCore core = tile_core(rows, cols, memory_mib * 0x1p20 - held_bytes, batch, demand);
  if (core.rows == 0)
    throw InputError(
        setting_name("memory"),
        fmt::format("{:.0f} MiB is too little for this network and frame", memory_mib),
        fmt::format(
            "give at least {:.0f} MiB",
            std::ceil((least_tile_bytes(rows, cols, batch, demand) + held_bytes) / 0x1p20)));
  return core;
}

void require_no_classical_settings(const DenoiseSettings& settings) {
  if (settings.strength != 1)
    throw InputError(setting_name("strength"), "a network takes out what it was trained to",
                     "leave it out, or use " + setting("method", "nl-ridge"));
  if (settings.profile != DenoiseSettings().profile)
    throw InputError(setting_name("profile"),
                     "a network has none; that of its guide is in its file",
                     "leave it out, or use " + setting("method", "nl-ridge"));
}

// The least and largest value of a result whose white is known. No light: broken weights give it,
// or a model and gain of another frame.
void require_plausible(double least, double largest, double white,
                       const std::filesystem::path& weights) {
  const double extreme = std::max(-least, largest) / white;
  if (std::isfinite(least) && std::isfinite(largest) && !(extreme > kMostWhites)) return;
  throw InputError(
      weights.string(),
      std::isfinite(extreme)
          ? fmt::format("gives up to {:.3g} times the white of this frame", extreme)
          : "gives values that are not numbers for this frame",
      "train the network again, or check " + setting("model") + " and " + setting("gain"));
}

// Highlights of a frame that are brighter than those of training are no news.
constexpr double kSmallShare = 0.01;

std::string brighter_than_training(const std::string& frame, double share,
                                   const NetworkPackage& package) {
  return fmt::format(
      "{}: {:.0f} % of its pixels are brighter against their noise than what the network was "
      "trained with; "
      "{}",
      frame, 100 * share,
      package.corrects_guide()
          ? fmt::format("there the result is that of {}", package.settings.guide)
          : "there it may take detail away: compare it with " + setting("method", "nl-ridge"));
}

}  // namespace

struct NetworkInference::State {
  std::filesystem::path weights;
  LoadedPackage loaded;
  InferenceSettings settings;
  TileDemand demand;
  torch::Device device{torch::kCPU};
  bool bfloat16 = false;
};

NetworkInference::NetworkInference(const std::filesystem::path& weights,
                                   const InferenceSettings& settings)
    : state_(std::make_unique<State>()) {
  state_->weights = weights;
  state_->loaded = load_package(weights);
  state_->settings = settings;
  const std::string& architecture = state_->loaded.package.network.architecture;
  state_->demand = tile_demand(state_->loaded.package.network, settings.device == "cpu");
  state_->bfloat16 = settings.precision == "bfloat16" &&
                     takes_bfloat16(architecture, settings.device, state_->demand);
  if (settings.device == "cuda") {
    if (!torch::cuda::is_available())
      throw InputError(setting("device", "cuda"), "this libtorch finds no CUDA device",
                       "leave it out, or build with a libtorch that has CUDA");
    state_->device = torch::kCUDA;
    // Without choose_fast_gpu_kernels: tiles come in many shapes, and trying kernels for each takes
    // longer than a frame.
    place_network(*state_->loaded.network, state_->device, kChannelsLast);
  }
}

NetworkInference::~NetworkInference() = default;

// A frame in the network's domain and what the network made of it.
struct NetworkInference::Filtered {
  NetworkFrame prepared;
  torch::Tensor planes;
  int rows = 0, cols = 0;  ///< of the frame
  Stopwatch network;
};

NetworkInference::Filtered NetworkInference::filter(RawFrame frame, const NoiseProfile& profile,
                                                    const DenoiseSettings& settings,
                                                    Progress& progress) {
  require_no_classical_settings(settings);
  const Stopwatch preparation;
  const std::string source = frame.source;
  const NetworkPackage& package = state_->loaded.package;
  const bool limited = package.corrects_guide() && !package.gives_picture();
  PackageSettings wanted = package.settings;
  wanted.row_noise = wanted.row_noise && settings.row_noise;
  NetworkFrame prepared =
      prepare_network_frame(std::move(frame), profile, wanted, settings, state_->settings.ratio,
                            progress, {.variance = limited});
  const SensorLayout& layout = prepared.domain.layout();
  const CellPhase phase = prepared.domain.phase_at(0, 0);
  const int frame_rows = prepared.frame.dn.rows(), frame_cols = prepared.frame.dn.cols();
  const std::int64_t rows = packed_size(phase.row + frame_rows, layout.rows()),
                     cols = packed_size(phase.col + frame_cols, layout.cols());
  const double frames =
      ((package.gives_picture() ? kPictureFrames : kMosaicFrames) + (limited ? 1.0 : 0.0)) *
      static_cast<double>(prepared.frame.dn.size());
  const int batch = state_->settings.tile_batch;
  const TileCore core = core_within(settings.memory_mib, 4 * (frames + settings.held_values), rows,
                                    cols, batch, state_->demand);
  prepared.report.times.push_back({"preparation", preparation.seconds()});
  const Stopwatch network;
  std::int64_t brighter = 0;  // places of the network's planes
  TiledResult result = run_tiled(
      {rows, cols, core, batch, state_->demand},
      [&](const TileSpan& r, const TileSpan& c) {
        // A frame may begin and end inside a cell.
        const auto [row0, row1] = pixels_of(r, layout.rows(), phase.row, frame_rows);
        const auto [col0, col1] = pixels_of(c, layout.cols(), phase.col, frame_cols);
        torch::Tensor input = prepare_input(prepared, {row0, col0, row1 - row0, col1 - col0});
        // Margins are other tiles' cores.
        const torch::Tensor own = input.slice(2, r.core_begin - r.begin, r.core_end - r.begin)
                                      .slice(3, c.core_begin - c.begin, c.core_end - c.begin);
        brighter += count_brighter(package, own);
        return input;
      },
      [&](const torch::Tensor& input) {
        const bool cuda = state_->device.is_cuda();
        const Autocast autocast(state_->bfloat16 && cuda, cuda);
        const internal::RoundedProducts rounded(state_->bfloat16 && !cuda);
        return apply_network(*state_->loaded.network, package, input.to(state_->device));
      },
      progress);
  prepared.report.tiles = result.tiles;
  if (const double share = static_cast<double>(brighter) / static_cast<double>(rows * cols);
      share > kSmallShare)
    progress.warn(brighter_than_training(source, share, package));
  // In the network's domain; the inverse of a stabilised one has no place for anything else.
  const auto [least, largest] = torch::aminmax(result.planes);
  require_plausible(least.item<double>(), largest.item<double>(),
                    std::numeric_limits<double>::infinity(), state_->weights);
  return {std::move(prepared), std::move(result.planes), frame_rows, frame_cols, network};
}

Denoised NetworkInference::denoise(RawFrame frame, const NoiseProfile& profile,
                                   const DenoiseSettings& settings, Progress& progress,
                                   bool want_variance) {
  if (target() != NetworkTarget::kMosaic)
    throw InputError(setting_name("method"), "this network gives pictures, not denoised mosaics",
                     "give a network trained with target = \"mosaic\"");
  if (want_variance && !state_->loaded.package.corrects_guide())
    throw InputError(
        setting_name("uncertainty"),
        state_->weights.string() + " corrects no classical result, whose error could be stated",
        "leave it out, or use " + setting("method", "nl-ridge"));
  const torch::InferenceMode no_gradients;
  Filtered filtered = filter(std::move(frame), profile, settings, progress);
  Image mosaic_dn =
      restore_output(filtered.prepared, filtered.planes, {0, 0, filtered.rows, filtered.cols});
  const PreparedFrame& frame_of_result = filtered.prepared.frame;
  double least = 0, largest = 0;
  for (int r = 0; r < filtered.rows; ++r)
    for (int c = 0; c < filtered.cols; ++c) {
      if (frame_of_result.saturated(r, c)) continue;  // comes back as it was
      const auto dn = static_cast<double>(mosaic_dn(r, c));
      least = std::min(least, dn);
      largest = std::max(largest, dn);
    }
  require_plausible(least, largest, frame_of_result.range_dn, state_->weights);
  finish_output(filtered.prepared, mosaic_dn);
  Denoised result = std::move(filtered.prepared.report);
  result.dn_above_black = std::move(mosaic_dn);
  result.kept_pixels = 0;  // the guide's: what a network makes of them is its own
  if (!want_variance) result.variance_dn2.reset();
  complete_result(frame_of_result, result);
  result.times.push_back({"network", filtered.network.seconds()});
  return result;
}

NetworkInference::Rendered NetworkInference::render(RawFrame frame, const NoiseProfile& profile,
                                                    const DenoiseSettings& settings,
                                                    Progress& progress) {
  MALUS_REQUIRE(target() != NetworkTarget::kMosaic);
  const torch::InferenceMode no_gradients;
  Filtered filtered = filter(std::move(frame), profile, settings, progress);
  Planes picture = picture_of(state_->loaded.package.settings, filtered.prepared.domain,
                              filtered.planes, filtered.rows, filtered.cols);
  for (const Image& plane : picture) {
    const auto [least, largest] = std::minmax_element(plane.values().begin(), plane.values().end());
    require_plausible(*least, *largest,
                      target() == NetworkTarget::kSrgb ? 1.0 : filtered.prepared.frame.range_dn,
                      state_->weights);
  }
  Denoised report = std::move(filtered.prepared.report);
  report.times.push_back({"network", filtered.network.seconds()});
  return {std::move(picture), filtered.prepared.domain.scale(), std::move(report)};
}

NetworkTarget NetworkInference::target() const { return state_->loaded.package.settings.gives(); }

OrderedJson NetworkInference::description() const {
  const NetworkPackage& package = state_->loaded.package;
  OrderedJson json{{"architecture", package.network.architecture},
                   {"settings", package.network.settings},
                   {"parameters", parameter_count(*state_->loaded.network)},
                   {"device", state_->settings.device},
                   {"precision", state_->bfloat16 ? "bfloat16" : "float32"},
                   {"tiled_equals_whole", state_->demand.exact},
                   {"training", package.training}};
  if (std::isfinite(package.brightest)) json["brightest"] = package.brightest;
  PackageSettings::describe(package.settings, [&](const auto& value, const ParameterInfo& info) {
    json["package"][info.name] = value;
  });
  return json;
}

}  // namespace malus
