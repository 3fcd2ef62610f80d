#include "malus/neural/noise_flow_training.h"

#include "malus/base/error.h"
#include "malus/base/pick.h"
#include "malus/base/stopwatch.h"
#include "malus/image/pack.h"
#include "malus/neural/internal/plane_tensors.h"
#include "malus/neural/noise_flow.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <numeric>
#include <set>
#include <utility>

#include <ATen/CPUGeneratorImpl.h>
#include <fmt/format.h>

namespace malus {
namespace {

using OrderedJson = nlohmann::ordered_json;

constexpr double kMostGradient = 10.0;

struct PlanePair {
  torch::Tensor noise, clean;  ///< [channel, row, col], unit scale
  double log_gain;
  /// Where crops without unknown pixels begin, row * columns + column; empty: anywhere.
  std::vector<std::int64_t> starts;
};

// Falls to nothing by a cosine.
void set_rate(torch::optim::Adam& adam, double first, int step, int steps) {
  const double phase = static_cast<double>(step) / steps;
  for (auto& group : adam.param_groups())
    static_cast<torch::optim::AdamOptions&>(group.options())
        .lr(first * 0.5 * (1 + std::cos(std::numbers::pi * phase)));
}

// The places where a crop holds no unknown pixel, of any channel; empty: all of them.
std::vector<std::int64_t> places_of_crops(const torch::Tensor& noise, int crop,
                                          const std::string& name) {
  const auto known = noise.isfinite().all(0);
  if (known.all().item().toBool()) return {};
  // Unknown pixels above and left of every place, a row and a column of zeros first.
  const auto sums = torch::constant_pad_nd(known.logical_not().to(torch::kLong), {1, 0, 1, 0})
                        .cumsum(0)
                        .cumsum(1);
  const auto rows = known.size(0), cols = known.size(1);
  const auto corner = [&](std::int64_t down, std::int64_t right) {
    return sums.slice(0, down, down + rows - crop + 1).slice(1, right, right + cols - crop + 1);
  };
  const auto inside = corner(crop, crop) - corner(0, crop) - corner(crop, 0) + corner(0, 0);
  const auto free = inside.eq(0).nonzero();
  if (free.size(0) == 0)
    throw InputError(name,
                     fmt::format("leaves no crop of {} pixels of a plane: everywhere some are at "
                                 "white, or no numbers, in it or in its clean frame, or defects",
                                 crop),
                     "expose less, give a smaller crop, or leave the pair out");
  const auto starts = (free.select(1, 0) * cols + free.select(1, 1)).contiguous();
  return {starts.data_ptr<std::int64_t>(), starts.data_ptr<std::int64_t>() + starts.numel()};
}

// The one converter's: frames of few codes may lie further apart. 0: none holds integers.
double common_step(const std::vector<NoiseFlowPair>& pairs) {
  std::int64_t step = 0;
  for (const NoiseFlowPair& pair : pairs)
    step = std::gcd(step, static_cast<std::int64_t>(pair.step_dn));
  return static_cast<double>(step);
}

// What the weight file says of the pairs.
void describe_pairs(const std::vector<NoiseFlowPair>& pairs, double step_dn,
                    NoiseFlowSensor& sensor) {
  std::set<double> gains_db;
  for (const NoiseFlowPair& pair : pairs) gains_db.insert(*pair.gain.decibel());
  sensor.gains_db.assign(gains_db.begin(), gains_db.end());
  sensor.lowest_gain_db = sensor.gains_db.front();
  sensor.highest_gain_db = sensor.gains_db.back();
  sensor.gains_in_iso = std::ranges::none_of(
      pairs, [](const NoiseFlowPair& pair) { return pair.gain.gain_db.has_value(); });
  const bool all_integers = std::all_of(pairs.begin(), pairs.end(),
                                        [](const NoiseFlowPair& pair) { return pair.step_dn > 0; });
  sensor.spread_dn = all_integers ? step_dn : 0.0;
}

PlanePair plane_pair(const NoiseFlowPair& pair, const NoiseFlowModel& model, double step_dn,
                     int crop, const at::Generator& generator) {
  const SensorLayout layout = model.layout();
  auto noisy = tensor_of_planes(pack(pair.noisy_dn, layout)).squeeze(0);
  if (pair.step_dn > 0)
    noisy = noisy + step_dn * (torch::rand(noisy.sizes(), generator, noisy.options()) - 0.5);
  const auto clean = tensor_of_planes(pack(pair.clean_dn, layout)).squeeze(0);
  const auto noise = (noisy - clean) / model.scale_dn();
  return {noise, clean / model.scale_dn(), NoiseFlowModel::log_gain(pair.gain),
          places_of_crops(noise, crop, pair.name)};
}

// Light and squared noise of a channel at a gain, summed over bins of light: x = (bin / kBins)^4
// puts them close together in the dark, where read noise shows.
struct LightBins {
  torch::Tensor count, light, square;  ///< [gain, channel, 1, bin]; means of a bin
  torch::Tensor gain;                  ///< [gain]
};

LightBins bins_of_light(const std::vector<PlanePair>& pairs) {
  constexpr std::int64_t kBins = 64;
  std::map<double, torch::Tensor> by_gain;  // [count, light, square] x [channel, bin]
  for (const PlanePair& pair : pairs) {
    const auto channels = pair.noise.size(0);
    auto& sums =
        by_gain.try_emplace(pair.log_gain, torch::zeros({3, channels, kBins}, torch::kDouble))
            .first->second;
    for (std::int64_t c = 0; c < channels; ++c) {
      const auto known = pair.noise[c].isfinite();
      const auto x = pair.clean[c].masked_select(known).to(torch::kDouble).clamp_min(0),
                 y = pair.noise[c].masked_select(known).to(torch::kDouble).square();
      const auto bin = (x.clamp_max(1).pow(0.25) * kBins).to(torch::kLong).clamp_max(kBins - 1);
      sums[0][c] += torch::bincount(bin, {}, kBins);
      sums[1][c] += torch::bincount(bin, x, kBins);
      sums[2][c] += torch::bincount(bin, y, kBins);
    }
  }
  std::vector<torch::Tensor> sums;
  std::vector<float> gains;
  for (const auto& [gain, of_gain] : by_gain) {
    sums.push_back(of_gain);
    gains.push_back(static_cast<float>(gain));
  }
  const auto all = torch::stack(sums, 1).unsqueeze(3);
  const auto counted = all[0].clamp_min(1);
  const auto single = [](const torch::Tensor& t) { return t.to(torch::kFloat); };
  return {single(all[0]), single(all[1] / counted), single(all[2] / counted), torch::tensor(gains)};
}

// Fits the signal-dependent layer by itself, by maximum likelihood over the bins of light. Read
// noise at a low gain lies decades below the mean noise of all pairs: training, whose rate is that
// of the couplings, would never come down to it.
void start(NoiseFlow& network, const std::vector<PlanePair>& pairs) {
  constexpr int kSteps = 600;
  constexpr double kRate = 0.05;  // of Adam: no parameter moves by more than its sum, e^15
  const LightBins bins = bins_of_light(pairs);
  const double pixels = bins.count.sum().item().toDouble();
  const auto mean = [&](const torch::Tensor& t) {
    return (t * bins.count).sum().item().toDouble() / pixels;
  };
  // From above: where the offset is far too small, the likelihood does not tell of it.
  const double square = mean(bins.square);
  network.start_at(square / std::max(mean(bins.light), 1e-6), square);
  const auto all = network.named_parameters(false);
  torch::optim::Adam adam({all["slope"], all["slope_gain"], all["offset"], all["offset_gain"]},
                          kRate);
  for (int step = 0; step < kSteps; ++step) {
    set_rate(adam, kRate, step, kSteps);
    const auto log_variance = 2 * network.log_deviation(bins.light, bins.gain);
    const auto loss =
        (bins.count * (log_variance + bins.square * torch::exp(-log_variance))).sum() / pixels;
    adam.zero_grad();
    loss.backward();
    adam.step();
  }
}

void check_pairs(const std::vector<NoiseFlowPair>& pairs, const SensorLayout& layout, int crop) {
  if (pairs.empty())
    throw InputError("Noise Flow", "there are no pairs to learn from",
                     "give noisy and clean frames");
  for (const NoiseFlowPair& pair : pairs) {
    if (pair.noisy_dn.rows() != pair.clean_dn.rows() ||
        pair.noisy_dn.cols() != pair.clean_dn.cols())
      throw InputError(pair.name, "a noisy and its clean frame differ in size",
                       "give frames of one scene");
    if (packed_size(pair.noisy_dn.rows(), layout.rows()) < crop ||
        packed_size(pair.noisy_dn.cols(), layout.cols()) < crop)
      throw InputError(pair.name, fmt::format("is smaller than crops of {}", crop),
                       "give larger frames or a smaller crop");
    if (!pair.gain.decibel())
      throw InputError(pair.name, "its gain is not known", "give gain_db or iso");
    // ISO 100 and 0 dB are two gains, though they have one number.
    if (const NoiseFlowPair& first = pairs.front();
        pair.gain.gain_db.has_value() != first.gain.gain_db.has_value())
      throw InputError(pair.name,
                       fmt::format("has the gain {}, {} has {}: these are two units",
                                   pair.gain.text(), first.name, first.gain.text()),
                       "give all gains in dB, or all in ISO");
  }
}

struct Batch {
  torch::Tensor noise, clean, gain;
};

std::pair<std::int64_t, std::int64_t> place_of_crop(const PlanePair& pair, int crop,
                                                    RandomSequence& random) {
  const auto rows = pair.noise.size(1), cols = pair.noise.size(2);
  if (!pair.starts.empty()) {
    const auto start = pair.starts[static_cast<std::size_t>(pick(random, std::ssize(pair.starts)))];
    return {start / cols, start % cols};
  }
  const auto row = pick(random, rows - crop + 1), col = pick(random, cols - crop + 1);
  return {row, col};
}

Batch draw_batch(const std::vector<PlanePair>& pairs, const NoiseFlowSettings& settings,
                 std::uint64_t seed, int step) {
  RandomSequence random(seed, static_cast<std::uint32_t>(step), Draw::kFlowCrop);
  std::vector<torch::Tensor> noise, clean;
  std::vector<float> gain;
  for (int i = 0; i < settings.batch; ++i) {
    const PlanePair& pair = pairs[static_cast<std::size_t>(pick(random, std::ssize(pairs)))];
    const auto [row, col] = place_of_crop(pair, settings.crop, random);
    const auto cut = [&](const torch::Tensor& t) {
      return t.slice(1, row, row + settings.crop).slice(2, col, col + settings.crop);
    };
    noise.push_back(cut(pair.noise));
    clean.push_back(cut(pair.clean));
    gain.push_back(static_cast<float>(pair.log_gain));
  }
  return {torch::stack(noise), torch::stack(clean), torch::tensor(gain)};
}

}  // namespace

NoiseFlowFit train_noise_flow(NoiseFlowSensor sensor, const std::vector<NoiseFlowPair>& pairs,
                              const NoiseFlowSettings& settings, std::uint64_t seed,
                              Progress& progress) {
  check_pairs(pairs, SensorLayout::named(sensor.layout), settings.crop);
  const double step_dn = common_step(pairs);
  describe_pairs(pairs, step_dn, sensor);
  torch::manual_seed(seed);
  NoiseFlowFit fit{NoiseFlowModel(std::move(sensor), settings.couplings, settings.width), {}};
  const auto generator = at::detail::createCPUGenerator(seed);
  std::vector<PlanePair> planes;
  for (const NoiseFlowPair& pair : pairs)
    planes.push_back(plane_pair(pair, fit.model, step_dn, settings.crop, generator));
  NoiseFlow& network = fit.model.network();
  start(network, planes);
  torch::optim::Adam adam(network.parameters(), torch::optim::AdamOptions(settings.learning_rate));
  const Stopwatch stopwatch;
  const double values = static_cast<double>(network.channels()) * settings.crop * settings.crop;
  progress.begin("training", settings.steps);
  OrderedJson log = OrderedJson::array();
  const int every = std::max(settings.steps / 50, 1);
  for (int step = 0; step < settings.steps; ++step) {
    check_stop(progress);
    set_rate(adam, settings.learning_rate, step, settings.steps);
    const Batch batch = draw_batch(planes, settings, seed, step);
    const auto loss = -network.log_likelihood(batch.noise, batch.clean, batch.gain).mean() / values;
    adam.zero_grad();
    loss.backward();
    torch::nn::utils::clip_grad_norm_(network.parameters(), kMostGradient);
    adam.step();
    const double nats = -loss.item().toDouble();
    if (!std::isfinite(nats))
      throw InputError("Noise Flow",
                       fmt::format("the likelihood is no number after {} steps", step),
                       "lower learning_rate, and look for pixels that are not finite");
    // Density of values in DN, not in the network's unit.
    if (step % every == 0 || step + 1 == settings.steps)
      log.push_back({{"step", step}, {"log_likelihood", nats - std::log(fit.model.scale_dn())}});
    progress.advance(1);
  }
  const double seconds = stopwatch.seconds();
  std::int64_t count = 0;
  for (const auto& parameter : network.parameters()) count += parameter.numel();
  fit.record = {{"architecture", kNoiseFlowArchitecture},
                {"parameters", count},
                {"steps", settings.steps},
                {"seconds", seconds},
                {"pairs", pairs.size()},
                {"device", "cpu"},
                {"workers", 1},
                {"log", log}};
  return fit;
}

}  // namespace malus
