#include "malus/neural/noise_flow_file.h"

#include "malus/base/error.h"
#include "malus/base/fingerprint.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/base/wording.h"
#include "malus/image/pack.h"
#include "malus/neural/internal/plane_tensors.h"
#include "malus/neural/named_source.h"
#include "malus/neural/network.h"
#include "malus/neural/noise_flow.h"
#include "malus/neural/threads.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <mutex>

#include <fmt/format.h>

namespace malus {
namespace noise_flow_memory {

// Noise without light, of the network's unit: couplings know neither mean nor variance in closed
// form.
struct DarkNoise {
  torch::Tensor mean;   ///< [1, channel, 1, 1]
  torch::Tensor share;  ///< its variance, of what the signal-dependent layer has
};

// What is measured once for every gain, by any thread; others wait for it. Meanwhile its own loops
// stay on its thread: a loop that waits for its parts may run another draw, which would wait here.
template <class Value>
class ByGain {
 public:
  template <class Measure>
  Value at(double gain_db, const Measure& measure) {
    const std::lock_guard lock(mutex_);
    if (const auto found = known_.find(gain_db); found != known_.end()) return found->second;
    const SerialLoops serial;
    return known_.emplace(gain_db, measure()).first->second;
  }

 private:
  std::mutex mutex_;
  std::map<double, Value> known_;
};

}  // namespace noise_flow_memory

namespace {

using noise_flow_memory::DarkNoise;

using Json = nlohmann::json;

constexpr const char* kFlowKey = "malus_noise_flow";
constexpr const char* kGiveAFlow = "give a weight file that malus train wrote for noise-flow";

double rounding_dn2(double step_dn) { return step_dn * step_dn / 12; }

// Couplings would carry a pixel that is no number to all within their reach.
Image finite_only(View<const float> dn) {
  Image out(dn.rows(), dn.cols());
  for (int r = 0; r < dn.rows(); ++r)
    std::transform(dn.row(r), dn.row(r) + dn.cols(), out.row(r),
                   [](float value) { return std::isfinite(value) ? value : 0.0f; });
  return out;
}

// Files from before the step was kept tell only that there was one, of 1 DN.
double spread_of(const Json& json) {
  const double before = json.value("spread_integers", false) ? 1.0 : 0.0;
  return json.value("spread_dn", before);
}

// Gains of pairs, of which the file tells the ends too.
bool rise_within(const std::vector<double>& gains_db, double lowest_db, double highest_db) {
  return lowest_db <= highest_db && std::ranges::is_sorted(gains_db) &&
         std::ranges::all_of(gains_db,
                             [&](double db) { return db >= lowest_db && db <= highest_db; });
}

// A sensor that draws can be made of: numbers that float holds, a step within the range.
bool is_possible(const NoiseFlowSensor& sensor, int channels) {
  constexpr double kMostDn = 0x1p32, kMostGainDb = 1000;
  if (std::ssize(sensor.black_dn) != channels) return false;
  const double range_dn = white_above_black(sensor.white_dn, sensor.black_dn);
  return range_dn > 0 && sensor.white_dn <= kMostDn &&
         std::ranges::all_of(sensor.black_dn, [](double dn) { return dn >= -kMostDn; }) &&
         sensor.spread_dn >= 0 && sensor.spread_dn <= range_dn &&
         std::max(-sensor.lowest_gain_db, sensor.highest_gain_db) <= kMostGainDb &&
         rise_within(sensor.gains_db, sensor.lowest_gain_db, sensor.highest_gain_db);
}

// Before the network is made: few bytes may declare one of many megabytes. Each step has a layer of
// width x width; where channels is odd there are no steps.
bool may_hold(const TensorFile& file, int channels, std::int64_t steps, std::int64_t width) {
  std::size_t bytes = 0;
  for (const auto& [name, tensor] : file.tensors) bytes += tensor.bytes.size();
  return channels % 2 != 0 || bytes >= static_cast<std::size_t>(steps * width * width);
}

torch::Tensor planes_of(View<const float> mosaic, const SensorLayout& layout, double scale) {
  Planes packed = pack(mosaic, layout);
  for (Image& plane : packed)
    for (float& value : plane.values())
      value = static_cast<float>(static_cast<double>(value) / scale);
  return tensor_of_planes(packed);
}

// Every parameter must be there with its shape, finite, and nothing left over.
void fill(NoiseFlow& network, const TensorFile& file, const std::string& source) {
  const torch::NoGradGuard no_gradients;
  const auto parameters = network.named_parameters();
  for (const auto& item : parameters) {
    const auto found = file.tensors.find(item.key());
    if (found == file.tensors.end() ||
        item.value().sizes() != torch::IntArrayRef(found->second.shape))
      throw InputError(source, fmt::format("its weight \"{}\" is missing or misshaped", item.key()),
                       kGiveAFlow);
    const auto values = to_torch(found->second);
    if (!torch::isfinite(values).all().item().toBool())
      throw InputError(source,
                       fmt::format("weight \"{}\" holds values that are not numbers", item.key()),
                       "train again");
    torch::Tensor(item.value()).copy_(values);
  }
  if (parameters.size() != file.tensors.size())
    throw InputError(source, "holds weights that belong to no layer", kGiveAFlow);
}

void require_numbers(NoiseFlow& network, const NoiseFlowSensor& sensor, const std::string& source) {
  const torch::NoGradGuard no_gradients;
  for (const double db : {sensor.lowest_gain_db, sensor.highest_gain_db}) {
    const GainSetting gain = GainSetting::at_decibel(db, sensor.gains_in_iso);
    if (!network.draws_numbers(NoiseFlowModel::log_gain(gain)))
      throw InputError(source,
                       fmt::format("its weights make noise of no numbers at {}", gain.text()),
                       "train again");
  }
}

// Standard normals by place in the whole frame, so that a crop draws the frame's own.
Image normals_at(int rows, int cols, const DrawAddress& address) {
  Image normals(rows, cols);
  parallel_for(0, rows, 16, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < cols; ++c) {
        const PhiloxBlock block =
            random_block(address.seed, address.frame,
                         pixel_index(address.row0 + r, address.col0 + c), Draw::kFlow);
        normals(r, c) =
            static_cast<float>(normal_quantile(uniform_open(block.word[0], block.word[1])));
      }
  });
  return normals;
}

// libtorch shares its loops among the threads and rounds at their ends in another way; with one
// thread the noise is the same, to the last bit, for any number of them.
struct OneThread {
  torch::NoGradGuard no_gradients;
  NetworkThreads network{1};
};

// What draw gives of strips of the planes, [1, channel, row, col], each made by one thread and cut
// off its margin of `reach` rows. Bounds and margins are the same for any number of threads.
// draw(cut): cut gives a tensor's part of the strip.
template <class Draw>
torch::Tensor by_strips(const torch::Tensor& planes, std::int64_t reach, const Draw& draw) {
  constexpr std::int64_t kRows = 128;  // with 8 couplings a quarter of the rows is made twice
  const std::int64_t rows = planes.size(2);
  auto out = torch::empty_like(planes);
  parallel_for(0, rows, kRows, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    const OneThread alone;
    for (std::int64_t first = begin; first < end; first += kRows) {
      const std::int64_t last = std::min<std::int64_t>(first + kRows, rows);
      const std::int64_t above = std::max<std::int64_t>(first - reach, 0);
      const auto drawn = draw([&](const torch::Tensor& whole) {
        return whole.slice(2, above, std::min(last + reach, rows)).contiguous();
      });
      out.slice(2, first, last).copy_(drawn.slice(2, first - above, last - above));
    }
  });
  return out;
}

DarkNoise dark_noise(NoiseFlow& network, const torch::Tensor& gain) {
  constexpr int kSide = 64;  // 4096 samples: 2 % of the variance
  const auto side = std::vector<std::int64_t>{1, network.channels(), kSide, kSide};
  auto normals = torch::empty(side);
  const Image drawn = normals_at(kSide, kSide * static_cast<int>(network.channels()), {});
  std::copy(drawn.values().begin(), drawn.values().end(), normals.data_ptr<float>());
  const auto dark = torch::zeros(side);
  const auto patch = network.inverse(normals, dark, gain);
  const auto mean = patch.mean({2, 3}, true);
  return {mean, (patch - mean).square().mean({2, 3}, true) /
                    torch::exp(2 * network.log_deviation(dark, gain)).mean({2, 3}, true)};
}

// Takes excess (of the network's unit) off the noise's variance by drawing the noise towards its
// mean. Both are those without light, the variance followed over the signal as the signal-dependent
// layer has it. Where there is light, the excess is small beside it.
torch::Tensor without_excess(const torch::Tensor& noise, const torch::Tensor& clean,
                             const torch::Tensor& gain, NoiseFlow& network, const DarkNoise& dark,
                             double excess) {
  const auto variance = dark.share * torch::exp(2 * network.log_deviation(clean, gain));
  return dark.mean + (noise - dark.mean) * torch::sqrt((1 - excess / variance).clamp_min(0));
}

RawFrame frame_of(const NoiseFlowSensor& sensor, Image dn, const GainSetting& gain) {
  RawFrame frame;
  frame.dn = std::move(dn);
  frame.layout = SensorLayout::named(sensor.layout);
  frame.black_dn = sensor.black_dn;
  frame.white_dn = sensor.white_dn;
  frame.gain = gain;
  frame.black_known = frame.white_known = frame.layout_known = true;
  return frame;
}

}  // namespace

struct NoiseFlowModel::State {
  NoiseFlowSensor sensor;
  std::int64_t steps, width;
  std::shared_ptr<NoiseFlow> network;
  Json training = {};
  noise_flow_memory::ByGain<noise_flow_memory::DarkNoise> dark = {};
  noise_flow_memory::ByGain<NoiseProfile> profiles = {};
};

void NoiseFlowSensor::require_gain(const GainSetting& gain) const {
  constexpr double kRoundingDb = 0.01;
  if (!gain.decibel())
    throw InputError("the gain", "is not known",
                     "give " + setting("gain") + " or " + setting("iso"));
  if ((gains_in_iso || !gains_db.empty()) && gains_in_iso == gain.gain_db.has_value())
    throw InputError(gain.text(), "is in another unit than the flow's own",
                     "give " + setting(gains_in_iso ? "iso" : "gain"));
  const double db = *gain.decibel();
  if (db >= lowest_gain_db - kRoundingDb && db <= highest_gain_db + kRoundingDb) return;
  const auto named = [&](double one) { return GainSetting::at_decibel(one, gains_in_iso).text(); };
  throw InputError(gain.text(),
                   fmt::format("the flow was trained from {} to {}", named(lowest_gain_db),
                               named(highest_gain_db)),
                   "give a gain inside");
}

NoiseFlowModel::NoiseFlowModel(NoiseFlowSensor sensor, std::int64_t steps, std::int64_t width) {
  const auto channels = SensorLayout::named(sensor.layout).channels();
  state_.reset(new State{std::move(sensor), steps, width,
                         std::make_shared<NoiseFlow>(channels, steps, width)});
}

NoiseFlowModel::~NoiseFlowModel() = default;
NoiseFlowModel::NoiseFlowModel(NoiseFlowModel&&) noexcept = default;
NoiseFlowModel& NoiseFlowModel::operator=(NoiseFlowModel&&) noexcept = default;

NoiseFlowModel::NoiseFlowModel(const std::filesystem::path& path) {
  const std::string source = path.string();
  const TensorFile file = load_tensor_file(path);
  const auto kind = file.metadata.find("architecture"), text = file.metadata.find(kFlowKey);
  if (kind == file.metadata.end() || kind->second != kNoiseFlowArchitecture ||
      text == file.metadata.end())
    throw InputError(source, "holds no Noise Flow", kGiveAFlow);
  try {
    const Json json = Json::parse(text->second);
    NoiseFlowSensor sensor{json.at("layout"),
                           json.at("black_dn").get<std::vector<double>>(),
                           json.at("white_dn"),
                           json.at("lowest_gain_db"),
                           json.at("highest_gain_db"),
                           spread_of(json),
                           json.value("gains_db", std::vector<double>{}),
                           json.value("gains_in_iso", false)};
    const std::int64_t steps = json.at("steps"), width = json.at("width");
    const int channels =
        naming_source(source, [&] { return SensorLayout::named(sensor.layout).channels(); });
    if (!is_possible(sensor, channels) || steps < 0 || steps > 64 || width < 1 || width > 1024)
      throw InputError(source, "its description does not fit together", kGiveAFlow);
    if (!may_hold(file, channels, steps, width))
      throw InputError(source, "holds fewer weights than its description tells of", kGiveAFlow);
    *this = NoiseFlowModel(std::move(sensor), steps, width);
    state_->training = json.value("training", Json());
  } catch (const Json::exception& error) {
    throw InputError(source, fmt::format("its description cannot be read ({})", error.what()),
                     kGiveAFlow);
  }
  fill(*state_->network, file, source);
  require_numbers(*state_->network, state_->sensor, source);
}

const NoiseFlowSensor& NoiseFlowModel::sensor() const { return state_->sensor; }
std::string NoiseFlowModel::camera_name() const {
  Fingerprint print;
  for (const auto& parameter : state_->network->parameters()) {
    const auto values = parameter.detach().to(torch::kFloat).contiguous();
    print.add({reinterpret_cast<const char*>(values.data_ptr<float>()), values.nbytes()});
  }
  return fmt::format("{} {}", kNoiseFlowCamera, print.text());
}
NoiseFlow& NoiseFlowModel::network() { return *state_->network; }
const Json& NoiseFlowModel::training() const { return state_->training; }

double NoiseFlowModel::scale_dn() const {
  return white_above_black(state_->sensor.white_dn, state_->sensor.black_dn);
}

double NoiseFlowModel::log_gain(const GainSetting& gain) {
  MALUS_REQUIRE(gain.decibel());
  return *gain.decibel() * kLogPerDb;
}

void NoiseFlowModel::save(const std::filesystem::path& path, const Json& training) const {
  TensorFile file;
  file.metadata["architecture"] = kNoiseFlowArchitecture;
  const NoiseFlowSensor& sensor = state_->sensor;
  file.metadata[kFlowKey] = Json{
      {"layout", sensor.layout},
      {"black_dn", sensor.black_dn},
      {"white_dn", sensor.white_dn},
      {"lowest_gain_db", sensor.lowest_gain_db},
      {"highest_gain_db", sensor.highest_gain_db},
      {"spread_dn", sensor.spread_dn},
      {"gains_db", sensor.gains_db},
      {"gains_in_iso", sensor.gains_in_iso},
      {"steps", state_->steps},
      {"width", state_->width},
      {"training", training}}.dump();
  for (const auto& item : state_->network->named_parameters())
    file.tensors[item.key()] = from_torch(item.value());
  save_tensor_file(file, path);
}

Image NoiseFlowModel::draw(View<const float> clean_dn, const GainSetting& gain,
                           const DrawAddress& address) const {
  return narrowed(clean_dn, gain, address, rounding_dn2(state_->sensor.spread_dn));
}

Image NoiseFlowModel::narrowed(View<const float> clean_dn, const GainSetting& gain,
                               const DrawAddress& address, double excess_dn2) const {
  state_->sensor.require_gain(gain);
  const SensorLayout cell = layout();
  const int rows = clean_dn.rows(), cols = clean_dn.cols();
  const auto clean = planes_of(finite_only(clean_dn).view(), cell, scale_dn()),
             normals = planes_of(normals_at(rows, cols, address).view(), cell, 1.0),
             log_gain_factor = torch::full({1}, log_gain(gain), torch::kFloat);
  NoiseFlow& network = *state_->network;
  DarkNoise dark;
  if (excess_dn2 > 0) {
    const OneThread alone;
    dark = state_->dark.at(*gain.decibel(), [&] { return dark_noise(network, log_gain_factor); });
  }
  const auto noise = by_strips(clean, network.reach(), [&](const auto& cut) {
    const auto light = cut(clean), drawn = network.inverse(cut(normals), light, log_gain_factor);
    if (excess_dn2 <= 0) return drawn;
    return without_excess(drawn, light, log_gain_factor, network, dark,
                          excess_dn2 / (scale_dn() * scale_dn()));
  });
  Image noisy(rows, cols);
  unpack(planes_of_tensor(noise), cell, noisy);
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      noisy(r, c) = static_cast<float>(static_cast<double>(clean_dn(r, c)) +
                                       static_cast<double>(noisy(r, c)) * scale_dn());
  return noisy;
}

RawFrame NoiseFlowModel::draw_raw(View<const float> clean_dn, const GainSetting& gain,
                                  const DrawAddress& address) const {
  const NoiseFlowSensor& sensor = state_->sensor;
  RawFrame frame =
      frame_of(sensor, narrowed(clean_dn, gain, address, 2 * rounding_dn2(sensor.spread_dn)), gain);
  round_as_camera(frame.dn, frame.layout, {sensor.black_dn, sensor.white_dn, sensor.spread_dn});
  frame.bits = 16;
  return frame;
}

RawFrame NoiseFlowModel::draw_as_recorded(View<const float> clean_dn, const GainSetting& gain,
                                          const DrawAddress& address) const {
  const NoiseFlowSensor& sensor = state_->sensor;
  if (sensor.spread_dn > 0) return draw_raw(clean_dn, gain, address);
  RawFrame frame = frame_of(sensor, draw(clean_dn, gain, address), gain);
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c)
      frame.dn(r, c) = std::min(frame.dn(r, c) + static_cast<float>(frame.black_at(r, c)),
                                static_cast<float>(sensor.white_dn));
  return frame;
}

NoiseProfile NoiseFlowModel::profile_at(const GainSetting& gain) const {
  state_->sensor.require_gain(gain);
  return state_->profiles.at(*gain.decibel(), [&] { return measured_profile(gain); });
}

}  // namespace malus
