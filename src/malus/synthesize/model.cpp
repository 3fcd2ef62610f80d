#include "malus/synthesize/model.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/text.h"
#include "malus/synthesize/internal/packed_rows.h"

#include <algorithm>

#include <fmt/format.h>

namespace malus {
namespace {

void require_equal_sizes(View<const float> clean, View<float> noisy) {
  if (clean.rows() == noisy.rows() && clean.cols() == noisy.cols()) return;
  throw InputError("noisy array",
                   fmt::format("{}x{} against a clean one of {}x{}", noisy.rows(), noisy.cols(),
                               clean.rows(), clean.cols()),
                   "give arrays of equal size");
}

constexpr int kMosaicRowsPerStrip = 32;
constexpr std::ptrdiff_t kPieces = 16;  // of a frame: enough for any balance between cores

// Rows first, first + 1, ... of the packed planes as a piece of the mosaic.
void join_strip(const std::vector<View<const float>>& planes, const SensorLayout& layout, int first,
                View<float> mosaic) {
  const auto step = static_cast<std::size_t>(layout.cols());
  std::vector<const float*> rows(step);
  for (int r = 0; r < mosaic.rows(); ++r) {
    for (std::size_t k = 0; k < step; ++k)
      rows[k] = planes[static_cast<std::size_t>(r % layout.rows()) * step + k].row(
          first + r / layout.rows());
    internal::join_row(step, rows.data(), static_cast<std::size_t>(planes[0].cols()),
                       mosaic.row(r));
  }
}

void split_strip(View<const float> mosaic, const SensorLayout& layout, int first,
                 const std::vector<View<float>>& planes) {
  const auto step = static_cast<std::size_t>(layout.cols());
  std::vector<float*> rows(step);
  for (int r = 0; r < mosaic.rows(); ++r) {
    for (std::size_t k = 0; k < step; ++k)
      rows[k] = planes[static_cast<std::size_t>(r % layout.rows()) * step + k].row(
          first + r / layout.rows());
    internal::split_row(step, mosaic.row(r), static_cast<std::size_t>(planes[0].cols()),
                        rows.data());
  }
}

}  // namespace

LevelCoverage NoiseAtGain::synthesize(View<const float> clean_dn, View<float> noisy_dn,
                                      std::uint64_t seed, std::uint32_t frame, int row0,
                                      int col0) const {
  require_equal_sizes(clean_dn, noisy_dn);
  return synthesizer_->draw_into(clean_dn, noisy_dn, gain_, DrawAddress{seed, frame, row0, col0})
      .coverage;
}

RawFrame NoiseAtGain::synthesize_raw(View<const float> clean_dn, std::uint64_t seed,
                                     std::uint32_t frame, int row0, int col0,
                                     FrameParameters* drawn) const {
  constexpr double kWhite16Bit = 65535;
  return synthesizer_->draw_raw(clean_dn, gain_, DrawAddress{seed, frame, row0, col0},
                                model().black_dn,
                                model().white_dn > 0 ? model().white_dn : kWhite16Bit, drawn);
}

void NoiseAtGain::require_planes(const std::vector<View<const float>>& clean_dn,
                                 const std::vector<View<float>>& noisy_dn) const {
  const SensorLayout& layout = model().layout;
  if (static_cast<int>(clean_dn.size()) != layout.channels() || noisy_dn.size() != clean_dn.size())
    throw InputError("packed array",
                     fmt::format("{} for the {} of {}", counted(std::ssize(clean_dn), "plane"),
                                 counted(layout.channels(), "channel"), layout.name()),
                     "give one plane per channel, in mosaic order");
  for (std::size_t k = 0; k < clean_dn.size(); ++k) {
    require_equal_sizes(clean_dn[0], noisy_dn[k]);
    require_equal_sizes(clean_dn[k], noisy_dn[k]);
  }
}

LevelCoverage NoiseAtGain::synthesize_packed(const std::vector<View<const float>>& clean_dn,
                                             const std::vector<View<float>>& noisy_dn,
                                             std::uint64_t seed, std::uint32_t frame) const {
  const SensorLayout& layout = model().layout;
  require_planes(clean_dn, noisy_dn);
  const auto packed_rows = static_cast<std::ptrdiff_t>(clean_dn[0].rows());
  // Long enough to outweigh a draw's fixed cost, short enough to stay in a core's cache.
  const std::ptrdiff_t strip = std::max(1, kMosaicRowsPerStrip / layout.rows());
  const std::ptrdiff_t strips = (packed_rows + strip - 1) / strip;
  const std::ptrdiff_t strips_per_piece = std::max<std::ptrdiff_t>(1, strips / kPieces);
  const auto draw_strips = [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    LevelCoverage coverage;
    Image mosaic;  // one per piece, reused by its strips
    for (std::ptrdiff_t i = begin; i < end; ++i) {
      const auto first = static_cast<int>(i * strip);
      const auto rows = static_cast<int>(std::min(strip, packed_rows - first));
      if (mosaic.rows() != rows * layout.rows())
        mosaic = Image(rows * layout.rows(), clean_dn[0].cols() * layout.cols());
      join_strip(clean_dn, layout, first, mosaic);
      const DrawAddress address{seed, frame, first * layout.rows(), 0};
      coverage.add(synthesizer_->draw_into(mosaic, mosaic, gain_, address).coverage);
      split_strip(mosaic, layout, first, noisy_dn);
    }
    return coverage;
  };
  return parallel_reduce(0, strips, strips_per_piece, LevelCoverage{}, draw_strips,
                         [](LevelCoverage total, const LevelCoverage& part) {
                           total.add(part);
                           return total;
                         });
}

NoiseAtGain NoiseAtGain::with_gain(const std::optional<double>& gain) const {
  if (!gain) return {synthesizer_, std::nullopt};
  const GainSetting setting = synthesizer_->model().setting_of(*gain);
  synthesizer_->require_gain(setting);  // refused here, not at the first draw
  return {synthesizer_, setting};
}

std::string NoiseAtGain::text() const {
  return synthesizer_->settings().kind + " at " + (gain_ ? gain_->text() : "random gains");
}

Model Model::load(const std::filesystem::path& path) { return Model(load_model(path)); }

Model::Model(NoiseModel description)
    : description_(std::make_shared<const NoiseModel>(std::move(description))) {}

GainSetting Model::gain_setting(double gain) const { return description_->setting_of(gain); }

NoiseAtGain Model::at_gain(double gain, const SynthesisSettings& settings) const {
  return at_random_gain(settings).with_gain(gain);
}

NoiseAtGain Model::at_random_gain(const SynthesisSettings& settings) const {
  return {std::make_shared<const Synthesizer>(description_, settings), std::nullopt};
}

}  // namespace malus
