#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/denoise/cut_off.h"
#include "malus/image/pack.h"
#include "malus/neural/internal/correction_limit.h"
#include "malus/neural/internal/plane_tensors.h"
#include "malus/neural/package.h"
#include "malus/polar/color_map.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

namespace malus {
namespace {

// Of the stabilised domain: planes come out between about 0 and 1 in any light.
constexpr double kLeastScale = 4.0, kScalePerMean = 3.0;
// Of the linear domain, where the light is not known: mid grey, and no more than this.
constexpr double kMeanLevel = 0.18, kMostAmplification = 1000.0;

template <class Map>
double mean_over(View<const float> dn, const Map& map) {
  const double sum = parallel_reduce(
      0, dn.rows(), kRowsPerTask, 0.0,
      [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
        double part = 0;
        for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
          for (int c = 0; c < dn.cols(); ++c) part += map(r, c, static_cast<double>(dn(r, c)));
        return part;
      },
      [](double a, double b) { return a + b; });
  return sum / (static_cast<double>(dn.rows()) * dn.cols());
}

// Curves that are estimated channel by channel bend at different places, and stabilised values then
// differ by more than their noise: colour, to a network. The channels of a sensor share their noise
// up to a few per cent, so they get one line.
NoiseProfile with_shared_line(NoiseProfile profile, double range_dn) {
  const double low_dn = 0.25 * range_dn, high_dn = range_dn;
  double low = 0, high = 0;
  for (const ChannelProfile& channel : profile.channels) {
    low += channel.variance(low_dn) / static_cast<double>(profile.channels.size());
    high += channel.variance(high_dn) / static_cast<double>(profile.channels.size());
  }
  const double slope_dn = std::max((high - low) / (high_dn - low_dn), 0.0);
  const auto line = VarianceCurve::affine(slope_dn, std::max(low - slope_dn * low_dn, 0.0));
  for (ChannelProfile& channel : profile.channels) channel.variance = line;
  return profile;
}

// The noise of a frame: for the classical steps, and for the network's domain.
struct DomainNoise {
  NoiseProfile classical, domain;
};

DomainNoise noise_for(const PackageSettings& settings, NoiseProfile profile, const RawFrame& frame,
                      const CutOff& cut_off) {
  // Without stabilisation no inverse takes back what the cut did to means.
  const bool stabilised = settings.domain == "stabilised";
  const auto shown = [&](NoiseProfile noise) {
    return stabilised ? as_shown(std::move(noise), frame, cut_off) : noise;
  };
  if (!settings.remove_bias) profile.clear_bias();
  if (stabilised) profile = before_cut_off(std::move(profile), frame);
  NoiseProfile domain =
      profile.estimated_from_picture
          ? with_shared_line(profile, white_above_black(frame.white_dn, frame.black_dn))
          : profile;
  return {shown(std::move(profile)), shown(std::move(domain))};
}

// Light that cut-off noise hardly leaves is no light of training: measured (docs/denoising.md), a
// correction is worse than none below half a deviation above the lowest code, and better above one.
float faded_to_guide(const NetworkFrame& frame, int row, int col, float network_dn) {
  const float guide_dn = frame.guide_dn(row, col);
  const double above = frame.domain.above_cut_off(row, col, std::max(double{guide_dn}, 0.0));
  return guide_dn +
         static_cast<float>(std::clamp(2 * above - 1, 0.0, 1.0)) * (network_dn - guide_dn);
}

// The frame's channels in the package's order.
std::vector<ChannelProfile> in_order_of(const SensorLayout& wanted, const SensorLayout& frame,
                                        CellPhase phase, const NoiseProfile& profile) {
  std::vector<ChannelProfile> channels(static_cast<std::size_t>(wanted.channels()));
  for (int r = 0; r < wanted.rows(); ++r)
    for (int c = 0; c < wanted.cols(); ++c)
      channels[static_cast<std::size_t>(wanted.channel_at(r + phase.row, c + phase.col))] =
          profile.channels[static_cast<std::size_t>(frame.channel_at(r, c))];
  return channels;
}

}  // namespace

FrameDomain::FrameDomain(const PackageSettings& settings, const PreparedFrame& frame,
                         const NoiseProfile& noise, std::optional<double> ratio)
    : layout_(SensorLayout::named(settings.layout)),
      phase_(settings.phase_of(frame.layout).value()),
      stabilised_(settings.domain == "stabilised"),
      noise_level_(settings.noise_input != "none"),
      least_deviation_dn_(Stabilizer::kLeastDeviation * frame.highest_dn) {
  NoiseProfile profile = noise;
  profile.channels = in_order_of(layout_, frame.layout, phase_, noise);
  for (const ChannelProfile& channel : profile.channels) {
    variances_.push_back(channel.variance);
    laws_.push_back(channel.law);
  }
  if (stabilised_) {
    stabilizers_ = make_stabilizers(profile, frame.highest_dn, 1.0);
    scale_ = kLeastScale + kScalePerMean * mean_over(frame.dn, [&](int r, int c, double dn) {
                             const auto k = static_cast<std::size_t>(
                                 layout_.channel_at(r + phase_.row, c + phase_.col));
                             return std::max(stabilizers_[k].forward(dn), 0.0);
                           });
    return;
  }
  double amplification = 1;
  if (settings.amplification == "ratio") {
    if (!ratio)
      throw InputError("the low-light ratio", "is not known, and the network needs it",
                       "give it, or use a network trained with amplification = \"auto\"");
    amplification = *ratio;
  } else {
    const double mean = mean_over(frame.dn, [](int, int, double dn) { return std::max(dn, 0.0); });
    amplification =
        std::clamp(kMeanLevel * frame.range_dn / std::max(mean, 1e-9), 1.0, kMostAmplification);
  }
  scale_ = frame.range_dn / amplification;
}

CellPhase FrameDomain::phase_at(int row, int col) const {
  return {(row + phase_.row) % layout_.rows(), (col + phase_.col) % layout_.cols()};
}

template <class Map>
torch::Tensor FrameDomain::mapped(View<const float> dn, CellPhase first, const Map& map) const {
  Image values(dn.rows(), dn.cols());
  parallel_for(0, dn.rows(), kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < dn.cols(); ++c) {
        const int channel = layout_.channel_at(r + first.row, c + first.col);
        values(r, c) = static_cast<float>(
            map(static_cast<std::size_t>(channel), static_cast<double>(dn(r, c))) / scale_);
      }
  });
  return tensor_of_planes(pack(values, layout_, first));
}

torch::Tensor FrameDomain::noisy_planes(View<const float> dn,
                                        std::optional<CellPhase> first) const {
  return mapped(dn, first.value_or(phase_), [&](std::size_t channel, double value) {
    return stabilised_ ? stabilizers_[channel].forward(value) : value;
  });
}

torch::Tensor FrameDomain::clean_planes(View<const float> dn,
                                        std::optional<CellPhase> first) const {
  return mapped(dn, first.value_or(phase_), [&](std::size_t channel, double value) {
    return stabilised_ ? stabilizers_[channel].mean_of(value) : value;
  });
}

torch::Tensor FrameDomain::noise_planes(View<const float> noisy_dn,
                                        std::optional<CellPhase> first) const {
  const CellPhase at = first.value_or(phase_);
  if (noise_level_ && !stabilised_)
    return mapped(noisy_dn, at, [&](std::size_t channel, double value) {
      const double variance_dn2 = std::max(variances_[channel](std::max(value, 0.0)), 0.0);
      return std::max(std::sqrt(variance_dn2), least_deviation_dn_);
    });
  return torch::full(
      {1, noise_level_ ? 1 : 0, packed_size(at.row + noisy_dn.rows(), layout_.rows()),
       packed_size(at.col + noisy_dn.cols(), layout_.cols())},
      1.0 / scale_);
}

double FrameDomain::above_cut_off(int row, int col, double dn) const {
  const CellPhase at = phase_at(row, col);
  const auto& law = laws_[static_cast<std::size_t>(layout_.channel_at(at.row, at.col))];
  return law && law->is_clipped() ? law->above_floor(dn) : std::numeric_limits<double>::infinity();
}

Image FrameDomain::mosaic_of(const torch::Tensor& planes, int rows, int cols,
                             std::optional<CellPhase> first) const {
  const CellPhase at = first.value_or(phase_);
  MALUS_REQUIRE(planes.dim() == 4 && planes.size(1) == layout_.channels());
  Image mosaic(rows, cols);
  unpack(planes_of_tensor(planes), layout_, mosaic, at);
  parallel_for(0, rows, kRowsPerTask, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < static_cast<int>(end); ++r)
      for (int c = 0; c < cols; ++c) {
        const double value = scale_ * static_cast<double>(mosaic(r, c));
        const auto k = static_cast<std::size_t>(layout_.channel_at(r + at.row, c + at.col));
        mosaic(r, c) = static_cast<float>(stabilised_ ? stabilizers_[k].inverse(value) : value);
      }
  });
  return mosaic;
}

NetworkFrame prepare_network_frame(RawFrame frame, const NoiseProfile& measured,
                                   const PackageSettings& settings,
                                   const DenoiseSettings& classical, std::optional<double> ratio,
                                   Progress& progress, WantedReport wanted_report) {
  MALUS_REQUIRE(!wanted_report.variance || settings.guide != "none");
  check_frame(frame, measured);
  if (!settings.phase_of(frame.layout))
    throw InputError(
        frame.source,
        fmt::format("has the layout {}, the network {}", frame.layout.name(), settings.layout),
        "give a network for this layout");
  CutOff cut_off = measure_cut_off(frame);
  const DomainNoise noise = noise_for(settings, measured, frame, cut_off);
  Denoised report;
  report.cut_off_share = cut_off.mean_share();
  report.cut_off_undone = has_cut_off_law(noise.domain);
  PreparedFrame prepared = prepare_frame(std::move(frame), noise.classical,
                                         {.remove_rows = settings.row_noise,
                                          .remove_columns = classical.column_noise,
                                          .fill_defects = classical.defects,
                                          .fill_impulses = classical.defects,
                                          .remove_pattern = classical.fixed_pattern,
                                          .compare_noise = wanted_report.noise_check},
                                         report);
  Image guide_dn;
  if (settings.guide != "none") {
    DenoiseSettings guide = classical;
    guide.method = settings.guide;
    guide.profile = settings.guide_profile;
    if (wanted_report.variance) report.variance_dn2 = Image(prepared.dn.rows(), prepared.dn.cols());
    filter_prepared(prepared, noise.classical, guide, progress, report);
    guide_dn = std::move(report.dn_above_black);
  }
  FrameDomain domain(settings, prepared, noise.domain, ratio);
  return {std::move(prepared), std::move(guide_dn), std::move(domain), std::move(cut_off),
          std::move(report)};
}

torch::Tensor prepare_input(const NetworkFrame& frame, const MosaicWindow& window) {
  const CellPhase first = frame.domain.phase_at(window.row0, window.col0);
  const auto cut = [&](View<const float> mosaic) {
    return mosaic.window(window.row0, window.col0, window.rows, window.cols);
  };
  const View<const float> noisy = cut(frame.frame.dn.view());
  std::vector<torch::Tensor> planes;
  if (!frame.guide_dn.empty())
    planes.push_back(frame.domain.clean_planes(cut(frame.guide_dn.view()), first));
  planes.push_back(frame.domain.noisy_planes(noisy, first));
  planes.push_back(frame.domain.noise_planes(noisy, first));
  return torch::cat(planes, 1);
}

torch::Tensor picture_target(const PackageSettings& settings, const FrameDomain& domain,
                             const Planes& rgb_dn) {
  MALUS_REQUIRE(rgb_dn.channels() == 3);
  const bool displayed = settings.gives() == NetworkTarget::kSrgb;
  Planes target = rgb_dn;
  for (Image& plane : target)
    for (float& value : plane.values()) {
      const double light = static_cast<double>(value) / domain.scale();
      value = displayed ? srgb_of_linear(light) / 255.0f : static_cast<float>(light);
    }
  return tensor_of_planes(target);
}

Planes picture_of(const PackageSettings& settings, const FrameDomain& domain,
                  const torch::Tensor& planes, int rows, int cols) {
  const CellPhase first = domain.phase_at(0, 0);
  torch::Tensor values = planes.to(torch::kCPU, torch::kFloat32)
                             .slice(2, first.row, first.row + rows)
                             .slice(3, first.col, first.col + cols);
  MALUS_REQUIRE(values.dim() == 4 && values.size(1) == 3 && values.size(2) == rows &&
                values.size(3) == cols);
  if (settings.gives() == NetworkTarget::kRgb) values = values * domain.scale();
  return planes_of_tensor(values);
}

Image restore_output(const NetworkFrame& frame, const torch::Tensor& planes,
                     const MosaicWindow& window) {
  Image mosaic = frame.domain.mosaic_of(planes, window.rows, window.cols,
                                        frame.domain.phase_at(window.row0, window.col0));
  for (int r = 0; r < window.rows; ++r)
    for (int c = 0; c < window.cols; ++c) {
      const int row = window.row0 + r, col = window.col0 + c;
      if (frame.frame.saturated(row, col))
        mosaic(r, c) = frame.frame.dn(row, col);
      else if (frame.report.cut_off_undone && !frame.guide_dn.empty())
        mosaic(r, c) = faded_to_guide(frame, row, col, mosaic(r, c));
    }
  return mosaic;
}

void finish_output(const NetworkFrame& frame, Image& mosaic_dn) {
  if (frame.report.variance_dn2)
    limit_correction(frame.guide_dn.view(), frame.report.variance_dn2->view(), mosaic_dn.view());
  if (frame.report.cut_off_undone) keep_voids(frame.cut_off, mosaic_dn);
}

}  // namespace malus
