#include "malus/synthesize/synthesizer.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/parameter_stream.h"
#include "malus/base/pick.h"
#include "malus/base/settings_check.h"
#include "malus/base/statistics.h"
#include "malus/base/wording.h"
#include "malus/noise/interpolate_kinds.h"
#include "malus/noise/level_noise.h"
#include "malus/synthesize/exact.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr std::ptrdiff_t kRowsPerPiece = 16;

template <class Change>
void change_pixels(View<const float> from, View<float> to, const Change& change) {
  parallel_for(0, to.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r)
      std::transform(from.row(r), from.row(r) + from.cols(), to.row(r), change);
  });
}

double mean_bias(const PhysicsNoise& noise) {
  double sum = 0;
  for (const PhysicsChannel& channel : noise.channels) sum += channel.mu_dn;
  return sum / static_cast<double>(noise.channels.size());
}

// U(-step/2, step/2), of words that no pixel's noise is made of.
float dither(double step_dn, const DrawAddress& address, int row, int col) {
  const PhiloxBlock block =
      random_block(address.seed, address.frame, pixel_index(row, col), Draw::kDither);
  return static_cast<float>(step_dn * (uniform_open(block.word[0]) - 0.5));
}

// The frame's bias frame, laid over the picture so that pixels meet their own place on the sensor;
// banks smaller than the picture repeat. Codes are whole numbers, and rounding their sums with
// multiples of K would shift the mean wherever K is near a simple fraction of the step: where the
// sum is rounded, dither_dn is the step, of which a uniform draw comes first.
void add_dark_frame(const DarkFrameBank& bank, const DrawAddress& address, double dither_dn,
                    View<float> dn) {
  RandomSequence random(address.seed, address.frame, Draw::kParameters, kStreamDarkFrame);
  const Image& dark = bank.frames_dn[pick(random, bank.frames_dn.size())];
  for (int r = 0; r < dn.rows(); ++r) {
    const float* row = dark.row((address.row0 + r) % dark.rows());
    for (int c = 0; c < dn.cols(); ++c) {
      dn(r, c) += row[(address.col0 + c) % dark.cols()];
      if (dither_dn > 0) dn(r, c) += dither(dither_dn, address, address.row0 + r, address.col0 + c);
    }
  }
}

// Rows and columns that every bias frame of the model has.
std::pair<int, int> dark_frame_size(const NoiseModel& model) {
  int rows = std::numeric_limits<int>::max(), cols = rows;
  for (const DarkFrameBank& bank : model.dark_frames) {
    rows = std::min(rows, bank.frames_dn.front().rows());
    cols = std::min(cols, bank.frames_dn.front().cols());
  }
  return {rows, cols};
}

// Black of integers that are multiplied: what lies below it is multiplied too, and would be cut off
// at 0. It takes a quarter of the integers at most; the light needs the others.
double amplified_black(double black_dn, double factor) {
  constexpr double kHighestBlack = 16384;
  if (factor <= 1) return black_dn;
  return std::max(black_dn, std::round(std::min(factor * black_dn, kHighestBlack)));
}

// The calibrated offset is a recorded frame's, rounding and all: its q²/12 is taken out here and
// comes back as uniform noise, or by the rounding itself; never both.
std::vector<GaussianChannel> gaussian_channels(const GaussianCalibration& calibration,
                                               double quantization_dn,
                                               const SynthesisSettings& settings) {
  const double rounding_dn2 = quantization_dn * quantization_dn / 12.0;
  std::vector<GaussianChannel> channels;
  for (std::size_t c = 0; c < calibration.slope_dn.size(); ++c)
    channels.push_back(
        {.slope_dn = settings.shot ? calibration.slope_dn[c] : 0.0,
         .offset_dn2 = settings.read ? calibration.offset_dn2[c] - rounding_dn2 : 0.0,
         .mu_dn = settings.bias && !calibration.bias_dn.empty() ? calibration.bias_dn[c] : 0.0});
  return channels;
}

// Dark frames bring all but the shot noise with them.
PhysicsParts parts_of(SynthesisKind kind, const SynthesisSettings& settings) {
  const bool all = kind != SynthesisKind::kDarkFrames;
  return {.shot = settings.shot,
          .read = all && settings.read,
          .row = all && settings.row,
          .quantization = all && settings.quantization,
          .bias = all && settings.bias};
}

void require_kind(const NoiseModel& model, SynthesisKind kind) {
  const std::string_view needed = model_kind_name(drawn_from(kind));
  if (!std::ranges::count(model.kinds(), drawn_from(kind)))
    throw InputError(model.name(), fmt::format("holds no {} model", needed),
                     fmt::format("calibrate with {}, or use one of: {}", setting("kinds", needed),
                                 joined(model_kind_names(model.kinds()))));
}

// What would change nothing is refused: whoever sets it expects something else of the kind.
void refuse_settings_without_meaning(SynthesisKind kind, const SynthesisSettings& s) {
  const bool gaussian = kind == SynthesisKind::kGaussian,
             levels = kind == SynthesisKind::kNonparametric,
             dark = kind == SynthesisKind::kDarkFrames;
  struct Changed {
    const char* name;
    SettingValue to;
    bool changed, means_nothing;
  };
  for (const Changed& part :
       {Changed{"exact", true, s.exact, kind != SynthesisKind::kPhysics},
        {"parameters", "mean", s.parameters == "mean", gaussian || levels || dark},
        {"shot", false, !s.shot, levels},
        {"read", false, !s.read, levels || dark},
        {"row", false, !s.row, gaussian || dark},
        {"bias", false, !s.bias, levels || dark},
        {"quantization", false, !s.quantization, levels || dark}})
    if (part.changed && part.means_nothing)
      throw InputError(setting(part.name, part.to), "is not defined for " + setting("kind", s.kind),
                       "use it with " + setting("kind", "physics"));
}

}  // namespace

SynthesisKind synthesis_kind(const std::string& name) {
  const auto found = std::ranges::find(kSynthesisKindNames, name);
  if (found == kSynthesisKindNames.end()) require_settings(SynthesisSettings{.kind = name});
  return static_cast<SynthesisKind>(found - kSynthesisKindNames.begin());
}

GainSetting random_gain(const NoiseModel& model, const SynthesisSettings& settings,
                        std::uint64_t seed, std::uint32_t frame) {
  const SynthesisKind kind = synthesis_kind(settings.kind);
  require_kind(model, kind);
  switch (kind) {
    case SynthesisKind::kGaussian:
      return random_gain(model.gaussian, seed, frame);
    case SynthesisKind::kNonparametric:
      return random_gain(model.nonparametric, seed, frame);
    case SynthesisKind::kDarkFrames: {
      RandomSequence random(seed, frame, Draw::kParameters, kStreamDarkGain);
      return model.dark_frames[pick(random, model.dark_frames.size())].gain;
    }
    case SynthesisKind::kPhysics:
    case SynthesisKind::kPoissonGaussian:
      break;
  }
  return model.random_gain(seed, frame);
}

Synthesizer::Synthesizer(NoiseModel model, SynthesisSettings settings)
    : Synthesizer(std::make_shared<const NoiseModel>(std::move(model)), std::move(settings)) {}

Synthesizer::Synthesizer(std::shared_ptr<const NoiseModel> model, SynthesisSettings settings)
    : model_(std::move(model)),
      settings_(std::move(settings)),
      cache_(std::make_shared<GainTableCache>()) {
  require_settings(settings_);
  kind_ = synthesis_kind(settings_.kind);
  require_kind(*model_, kind_);
  refuse_settings_without_meaning(kind_, settings_);
}

DrawAddress Synthesizer::somewhere(int rows, int cols, std::uint64_t seed,
                                   std::uint32_t frame) const {
  DrawAddress address{.seed = seed, .frame = frame};
  if (kind_ != SynthesisKind::kDarkFrames) return address;
  RandomSequence random(seed, frame, Draw::kParameters, kStreamDarkPlace);
  const auto place = [&](int room, int step) {
    return step *
           static_cast<int>(pick(random, static_cast<std::size_t>(std::max(room, 0) / step + 1)));
  };
  const auto [dark_rows, dark_cols] = dark_frame_size(*model_);
  address.row0 = place(dark_rows - rows, std::lcm(model_->layout.rows(), model_->row_group));
  address.col0 = place(dark_cols - cols, model_->layout.cols());
  return address;
}

std::string Synthesizer::repetition(int rows, int cols) const {
  if (kind_ != SynthesisKind::kDarkFrames) return {};
  const auto [dark_rows, dark_cols] = dark_frame_size(*model_);
  // Dark frames lack what is no whole cell at the sensor's lower and right edge.
  if (rows < dark_rows + model_->layout.rows() && cols < dark_cols + model_->layout.cols())
    return {};
  return fmt::format(
      "the model's dark frames of {} x {} pixels are laid side by side to fill {} x {}: their "
      "noise repeats",
      dark_cols, dark_rows, cols, rows);
}

GainTables Synthesizer::make_tables(const GainSetting& gain) const {
  GainTables tables;
  tables.gain = gain;
  if (kind_ == SynthesisKind::kGaussian) {
    const auto channels =
        gaussian_channels(model_->gaussian_at(gain), model_->quantization_dn, settings_);
    tables.compiled =
        CompiledNoise::gaussian(model_->layout, channels, model_->row_group,
                                settings_.quantization ? model_->quantization_dn : 0.0);
    for (const GaussianChannel& channel : channels)
      tables.global_bias_dn += channel.mu_dn / static_cast<double>(channels.size());
    return tables;
  }
  if (kind_ == SynthesisKind::kNonparametric) {
    const NonparametricCalibration calibration = model_->nonparametric_at(gain);
    const int row_group = settings_.row ? model_->row_group : 0;
    for (const NonparametricChannel& channel : calibration.channels)
      tables.global_bias_dn +=
          level_moments(channel, 0).mean_dn / static_cast<double>(calibration.channels.size());
    tables.levels = sampler_of_levels(*model_, calibration, row_group, false);
    tables.level_ranges = level_ranges(calibration);
    if (model_->quantization_dn > 0)
      tables.rounded_levels = sampler_of_levels(*model_, calibration, row_group, true);
    return tables;
  }
  tables.parameters.emplace(*model_,
                            model_->parameters_at(gain, gain_range(settings_.extrapolate_gain)));
  PhysicsNoise mean = tables.parameters->mean();
  // The mean frame's bias, not one frame's: what is left varies as it does on real frames.
  if (settings_.bias) tables.global_bias_dn = mean_bias(mean);
  mean.parts = parts_of(kind_, settings_);
  if (kind_ == SynthesisKind::kPoissonGaussian)
    tables.compiled = CompiledNoise::poisson_gaussian(mean);
  else if (!settings_.exact)
    tables.compiled = CompiledNoise(mean);
  return tables;
}

FrameParameters Synthesizer::physical(const GainTables& tables, View<const float> signal_dn,
                                      View<float> noisy_dn, const DrawAddress& address,
                                      bool rounded_later) const {
  FrameParameters frame;
  frame.gain = tables.gain;
  frame.global_bias_dn = tables.global_bias_dn;
  frame.physics = settings_.parameters == "sampled"
                      ? tables.parameters->draw(address.seed, address.frame)
                      : tables.parameters->mean();
  frame.physics.parts = parts_of(kind_, settings_);
  if (rounded_later) frame.physics.parts.quantization = false;
  if (settings_.exact)
    add_noise_exact(frame.physics, signal_dn, noisy_dn, address);
  else
    tables.compiled->with_parameters(frame.physics).apply(signal_dn, noisy_dn, address);
  if (kind_ == SynthesisKind::kDarkFrames)
    add_dark_frame(model_->dark_frames_at(tables.gain), address,
                   rounded_later ? model_->quantization_dn : 0.0, noisy_dn);
  return frame;
}

std::shared_ptr<const GainTables> Synthesizer::tables_at(const GainSetting& gain) const {
  return cache_->at(gain, [this](const GainSetting& missing) { return make_tables(missing); });
}

void Synthesizer::require_gain(const GainSetting& gain) const {
  tables_at(gain);
  if (kind_ == SynthesisKind::kDarkFrames) model_->dark_frames_at(gain);
}

FrameParameters Synthesizer::noisy(View<const float> clean_dn, View<float> noisy_dn,
                                   const std::optional<GainSetting>& gain,
                                   const DrawAddress& address, bool rounded_later) const {
  MALUS_REQUIRE(clean_dn.rows() == noisy_dn.rows() && clean_dn.cols() == noisy_dn.cols());
  require_place(address, noisy_dn.rows(), noisy_dn.cols());
  const auto tables =
      tables_at(gain ? *gain : random_gain(*model_, settings_, address.seed, address.frame));
  View<const float> signal_dn = clean_dn;
  if (settings_.ratio != 1) {
    const auto factor = static_cast<float>(1.0 / settings_.ratio);
    change_pixels(clean_dn, noisy_dn, [factor](float v) { return v * factor; });
    signal_dn = noisy_dn;
  }
  if (tables->parameters) return physical(*tables, signal_dn, noisy_dn, address, rounded_later);
  FrameParameters frame;
  if (tables->levels) {
    frame.coverage =
        level_coverage(model_->layout, tables->level_ranges, signal_dn, address.row0, address.col0);
    (rounded_later && tables->rounded_levels ? tables->rounded_levels : tables->levels)
        ->apply(signal_dn, noisy_dn, address);
  } else if (rounded_later) {
    tables->compiled->without_quantization().apply(signal_dn, noisy_dn, address);
  } else {
    tables->compiled->apply(signal_dn, noisy_dn, address);
  }
  frame.gain = tables->gain;
  frame.global_bias_dn = tables->global_bias_dn;
  return frame;
}

FrameParameters Synthesizer::draw_into(View<const float> clean_dn, View<float> noisy_dn,
                                       const std::optional<GainSetting>& gain,
                                       const DrawAddress& address) const {
  FrameParameters frame = noisy(clean_dn, noisy_dn, gain, address, false);
  if (!settings_.debias) frame.global_bias_dn = 0;
  if (settings_.debias || (settings_.amplify && settings_.ratio != 1)) {
    const auto bias = static_cast<float>(frame.global_bias_dn);
    const float factor = settings_.amplify ? static_cast<float>(settings_.ratio) : 1.0f;
    change_pixels(noisy_dn, noisy_dn, [bias, factor](float v) { return (v - bias) * factor; });
  }
  return frame;
}

SyntheticFrame Synthesizer::draw(View<const float> clean_dn, const std::optional<GainSetting>& gain,
                                 const DrawAddress& address) const {
  SyntheticFrame frame;
  frame.dn = Image(clean_dn.rows(), clean_dn.cols());
  static_cast<FrameParameters&>(frame) = draw_into(clean_dn, frame.dn, gain, address);
  return frame;
}

RawFrame Synthesizer::draw_raw(View<const float> clean_dn, const std::optional<GainSetting>& gain,
                               const DrawAddress& address, const std::vector<double>& black_dn,
                               double white_dn, FrameParameters* drawn) const {
  MALUS_REQUIRE(static_cast<int>(black_dn.size()) == model_->layout.channels());
  SyntheticFrame noise;
  noise.dn = Image(clean_dn.rows(), clean_dn.cols());
  static_cast<FrameParameters&>(noise) = noisy(clean_dn, noise.dn, gain, address, true);
  if (drawn) *drawn = noise;
  CameraOutput camera{black_dn, white_dn, model_->quantization_dn};
  round_as_camera(noise.dn, model_->layout, camera, address.row0, address.col0);
  RawFrame raw;
  raw.layout = model_->layout;
  raw.black_dn = black_dn;
  raw.white_dn = white_dn;
  raw.gain = noise.gain;
  raw.black_known = raw.white_known = raw.layout_known = true;
  if (settings_.debias || settings_.amplify) {
    const auto factor = settings_.amplify ? settings_.ratio : 1.0;
    const double bias = settings_.debias ? factor * noise.global_bias_dn : 0.0;
    for (double& black : raw.black_dn) black = amplified_black(black, factor);
    // Codes begin at 0: readers refuse a black below it.
    const double lowest = *std::min_element(raw.black_dn.begin(), raw.black_dn.end()) + bias;
    for (double& black : raw.black_dn) black += std::max(0.0, std::ceil(-lowest));
    raw.white_dn = std::min(kHighestInteger, std::ceil(mean_of(raw.black_dn) +
                                                       factor * (white_dn - mean_of(black_dn))));
    camera = {raw.black_dn, kHighestInteger, 1.0};
    for (int r = 0; r < noise.dn.rows(); ++r)
      for (int c = 0; c < noise.dn.cols(); ++c) {
        const double black = black_dn[static_cast<std::size_t>(
            model_->layout.channel_at(address.row0 + r, address.col0 + c))];
        noise.dn(r, c) = static_cast<float>(factor * (static_cast<double>(noise.dn(r, c)) - black));
      }
    round_as_camera(noise.dn, model_->layout, camera, address.row0, address.col0);
    // A bias of a fraction of a step could not be taken from codes, and white would not be where
    // they saturate.
    for (double& black : raw.black_dn) black += bias;
  }
  raw.dn = std::move(noise.dn);
  raw.bits = 16;
  return raw;
}

void round_as_camera(View<float> dn, const SensorLayout& layout, const CameraOutput& camera,
                     int row0, int col0) {
  const auto step = static_cast<float>(camera.whole_step_dn()),
             white = static_cast<float>(camera.white_dn);
  parallel_for(0, dn.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r)
      for (int c = 0; c < dn.cols(); ++c) {
        const auto channel = static_cast<std::size_t>(layout.channel_at(row0 + r, col0 + c));
        const float raw = dn(r, c) + static_cast<float>(camera.black_dn[channel]);
        const float rounded = std::nearbyint(raw / step) * step;
        dn(r, c) = rounded > 0.0f ? std::min(rounded, white) : 0.0f;  // NaN fails the comparison
      }
  });
}

}  // namespace malus
