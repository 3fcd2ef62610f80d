#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/denoise/cut_off.h"
#include "malus/image/pack.h"
#include "malus/neural/package.h"
#include "malus/neural/plane_tensors.h"
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

// The frame's channels in the package's order.
std::vector<ChannelProfile> in_order_of(const SensorLayout& wanted, const SensorLayout& frame,
                                        CellPhase phase, const NoiseProfile& profile) {
  std::vector<ChannelProfile> channels = profile.channels;
  for (int r = 0; r < frame.rows(); ++r)
    for (int c = 0; c < frame.cols(); ++c)
      channels[static_cast<std::size_t>(wanted.channel_at(r + phase.row, c + phase.col))] =
          profile.channels[static_cast<std::size_t>(frame.channel_at(r, c))];
  return channels;
}

}  // namespace

FrameDomain::FrameDomain(const PackageSettings& settings, const PreparedFrame& frame,
                         const NoiseProfile& given, std::optional<double> ratio)
    : layout_(SensorLayout::named(settings.layout)),
      phase_(frame.layout.phase_in(layout_).value()),
      stabilised_(settings.domain == "stabilised"),
      noise_level_(settings.noise_input != "none") {
  NoiseProfile profile =
      given.estimated_from_picture ? with_shared_line(given, frame.range_dn) : given;
  profile.channels = in_order_of(layout_, frame.layout, phase_, profile);
  for (const ChannelProfile& channel : profile.channels) variances_.push_back(channel.variance);
  if (stabilised_) {
    stabilizers_ = make_stabilizers(profile, frame.range_dn, 1.0);
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
      return std::sqrt(std::max(variances_[channel](std::max(value, 0.0)), 0.0));
    });
  return torch::full(
      {1, noise_level_ ? 1 : 0, packed_size(at.row + noisy_dn.rows(), layout_.rows()),
       packed_size(at.col + noisy_dn.cols(), layout_.cols())},
      1.0 / scale_);
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
  if (const SensorLayout wanted = SensorLayout::named(settings.layout);
      !frame.layout.phase_in(wanted))
    throw InputError(
        frame.source,
        fmt::format("has the layout {}, the network {}", frame.layout.name(), settings.layout),
        "give a network for this layout");
  NoiseProfile profile = measured;
  if (!settings.remove_bias) profile.clear_bias();
  Denoised report;
  report.cut_off_share = measure_cut_off(frame).mean_share();
  PreparedFrame prepared = prepare_frame(std::move(frame), profile,
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
    filter_prepared(prepared, profile, guide, progress, report);
    guide_dn = std::move(report.dn_above_black);
  }
  FrameDomain domain(settings, prepared, profile, ratio);
  return {std::move(prepared), std::move(guide_dn), std::move(domain), std::move(report)};
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
  const bool displayed = settings.target == "srgb";
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
  if (settings.target == "rgb") values = values * domain.scale();
  return planes_of_tensor(values);
}

Image restore_output(const NetworkFrame& frame, const torch::Tensor& planes,
                     const MosaicWindow& window) {
  Image mosaic = frame.domain.mosaic_of(planes, window.rows, window.cols,
                                        frame.domain.phase_at(window.row0, window.col0));
  for (int r = 0; r < window.rows; ++r)
    for (int c = 0; c < window.cols; ++c)
      if (frame.frame.saturated(window.row0 + r, window.col0 + c))
        mosaic(r, c) = frame.frame.dn(window.row0 + r, window.col0 + c);
  return mosaic;
}

}  // namespace malus
