#include "malus/synthesize/compiled.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/synthesize/compiled_kernel.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <numeric>
#include <type_traits>

namespace malus {
namespace {

// The rows of one phase of the cell: channel parameters repeated along the row.
struct LaneArrays {
  std::vector<float> gain_dn, electrons_per_dn, variance_dn2, scale_dn, black_dn, mu_dn,
      sigma_row_dn;
  std::vector<std::uint32_t> first_line;
};

LaneArrays lane_arrays(const CompiledParts& parts, int phase, int period,
                       const CameraOutput& camera) {
  LaneArrays lanes;
  for (int c = 0; c < period; ++c) {
    const auto number = static_cast<std::size_t>(parts.layout.channel_at(phase, c));
    const CompiledChannel& channel = parts.channels[number];
    lanes.gain_dn.push_back(channel.gain_dn);
    lanes.electrons_per_dn.push_back(channel.electrons_per_dn);
    lanes.variance_dn2.push_back(channel.variance_dn2);
    lanes.scale_dn.push_back(channel.scale_dn);
    lanes.mu_dn.push_back(channel.mu_dn);
    lanes.sigma_row_dn.push_back(channel.sigma_row_dn);
    lanes.black_dn.push_back(camera.black_dn.empty() ? 0.0f
                                                     : static_cast<float>(camera.black_dn[number]));
    lanes.first_line.push_back(channel.first_line - kTailFirst);
  }
  return lanes;
}

}  // namespace

CompiledNoise::CompiledNoise(const PhysicsNoise& noise) {
  check_physics(noise);
  parts_.channels.resize(noise.channels.size());
  if (noise.parts.read) make_read_lines(noise);
  use_physics(noise);
}

CompiledNoise CompiledNoise::poisson_gaussian(const PhysicsNoise& noise) {
  check_physics(noise);
  CompiledNoise compiled;
  compiled.gaussian_read_ = true;
  compiled.parts_.channels.resize(noise.channels.size());
  if (noise.parts.read)
    compiled.parts_.read_lines = std::make_shared<const std::vector<TailLine>>(normal_tail_lines());
  compiled.use_physics(noise);
  return compiled;
}

CompiledNoise CompiledNoise::with_parameters(const PhysicsNoise& noise) const {
  check_physics(noise);
  MALUS_REQUIRE(noise.channels.size() == parts_.channels.size() &&
                noise.parts.read == (parts_.read_lines != nullptr));
  CompiledNoise compiled = *this;
  compiled.use_physics(noise);
  return compiled;
}

// Equal lambdas share their lines.
void CompiledNoise::make_read_lines(const PhysicsNoise& noise) {
  std::map<double, std::uint32_t> first_of_lambda;
  std::vector<TailLine> lines;
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    const double lambda = noise.channels[c].lambda;
    const auto [found, is_new] =
        first_of_lambda.try_emplace(lambda, static_cast<std::uint32_t>(lines.size()));
    if (is_new) append_tukey_lambda_lines(lambda, lines);
    parts_.channels[c].first_line = found->second;
  }
  parts_.read_lines = std::make_shared<const std::vector<TailLine>>(std::move(lines));
}

void CompiledNoise::use_physics(const PhysicsNoise& noise) {
  parts_.layout = noise.layout;
  parts_.row_group = noise.row_group;
  parts_.row_drift = noise.row_drift;
  parts_.row_noise = noise.parts.row;
  parts_.shot = noise.parts.shot ? ShotKind::kPoisson : ShotKind::kNone;
  parts_.quantization_dn =
      noise.parts.quantization ? static_cast<float>(noise.quantization_dn) : 0.0f;
  for (std::size_t c = 0; c < noise.channels.size(); ++c) {
    const PhysicsChannel& p = noise.channels[c];
    CompiledChannel& channel = parts_.channels[c];
    channel.gain_dn = static_cast<float>(p.gain_dn_per_e);
    channel.electrons_per_dn = static_cast<float>(1.0 / p.gain_dn_per_e);
    channel.mu_dn = noise.parts.bias ? static_cast<float>(p.mu_dn) : 0.0f;
    channel.sigma_row_dn = static_cast<float>(p.sigma_row_dn);
    channel.scale_dn =
        static_cast<float>(gaussian_read_ ? std::sqrt(read_variance_dn2(p)) : p.sigma_tl_dn);
  }
}

CompiledNoise CompiledNoise::without_quantization() const {
  CompiledNoise compiled = *this;
  compiled.parts_.quantization_dn = 0.0f;
  return compiled;
}

CompiledNoise CompiledNoise::gaussian(const SensorLayout& layout,
                                      const std::vector<GaussianChannel>& channels, int row_group,
                                      double quantization_dn) {
  MALUS_REQUIRE(static_cast<int>(channels.size()) == layout.channels() && row_group >= 1);
  CompiledNoise compiled;
  compiled.parts_.layout = layout;
  compiled.parts_.row_group = row_group;
  compiled.parts_.shot = ShotKind::kGaussian;
  compiled.parts_.quantization_dn = static_cast<float>(quantization_dn);
  for (const GaussianChannel& g : channels) {
    CompiledChannel channel;
    channel.gain_dn = static_cast<float>(g.slope_dn);
    channel.variance_dn2 = static_cast<float>(g.offset_dn2);
    channel.mu_dn = static_cast<float>(g.mu_dn);
    channel.sigma_row_dn = static_cast<float>(g.sigma_row_dn);
    compiled.parts_.channels.push_back(channel);
  }
  return compiled;
}

// Rows of float or of 16-bit pixels; Byte is const where they are read.
template <class Byte>
struct CompiledNoise::PixelRows {
  template <class Pixel>
  explicit PixelRows(View<Pixel> view)
      : first(reinterpret_cast<Byte*>(view.data())),
        stride_bytes(view.stride() * static_cast<std::ptrdiff_t>(sizeof(Pixel))),
        rows(view.rows()),
        cols(view.cols()),
        u16(std::is_same_v<std::remove_const_t<Pixel>, std::uint16_t>) {}
  Byte* row(std::ptrdiff_t r) const { return first + r * stride_bytes; }

  Byte* first;
  std::ptrdiff_t stride_bytes;
  int rows, cols;
  bool u16;
};

void CompiledNoise::run(const PixelRows<const char>& in, const PixelRows<char>& out,
                        const DrawAddress& address, const CameraOutput& camera) const {
  MALUS_REQUIRE(in.rows == out.rows && in.cols == out.cols);
  require_place(address, in.rows, in.cols);
  MALUS_REQUIRE(!(in.u16 || out.u16) || camera.black_dn.size() == parts_.channels.size());
  const int period = std::lcm(parts_.layout.cols(), kGroupColumns);
  std::vector<LaneArrays> phases;
  for (int phase = 0; phase < parts_.layout.rows(); ++phase)
    phases.push_back(lane_arrays(parts_, phase, period, camera));
  internal::RowJob job;
  job.tables = {normal_tail_lines().data(), parts_.read_lines ? parts_.read_lines->data() : nullptr,
                parts_.shot, out.u16 ? 0.0f : parts_.quantization_dn};
  job.seed = address.seed;
  job.frame = address.frame;
  job.col0 = address.col0;
  job.cols = in.cols;
  job.in_u16 = in.u16;
  job.out_u16 = out.u16;
  job.step_dn = static_cast<float>(camera.whole_step_dn());
  job.white_dn = static_cast<float>(std::min(camera.white_dn, 65535.0));
  std::vector<double> deviates(static_cast<std::size_t>(in.rows), 0.0);
  if (parts_.row_noise)
    deviates = row_deviates(address, in.rows, parts_.row_group, parts_.row_drift);
  constexpr std::ptrdiff_t kRowsPerPiece = 8;
  parallel_for(0, in.rows, kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    internal::RowJob mine = job;
    std::vector<float> offset_dn(static_cast<std::size_t>(period));
    for (std::ptrdiff_t r = begin; r < end; ++r) {
      mine.row = address.row0 + static_cast<int>(r);
      const LaneArrays& lanes = phases[static_cast<std::size_t>(mine.row % parts_.layout.rows())];
      const auto z = static_cast<float>(deviates[static_cast<std::size_t>(r)]);
      for (std::size_t c = 0; c < offset_dn.size(); ++c)
        offset_dn[c] = lanes.mu_dn[c] + lanes.sigma_row_dn[c] * z;
      mine.lanes = {period,
                    lanes.gain_dn.data(),
                    lanes.electrons_per_dn.data(),
                    lanes.variance_dn2.data(),
                    lanes.scale_dn.data(),
                    offset_dn.data(),
                    lanes.black_dn.data(),
                    lanes.first_line.data()};
      mine.in = in.row(r);
      mine.out = out.row(r);
      internal::run_row(mine);
    }
  });
}

void CompiledNoise::apply(View<const float> clean_dn, View<float> noisy_dn,
                          const DrawAddress& address) const {
  run(PixelRows<const char>(clean_dn), PixelRows<char>(noisy_dn), address, {});
}

void CompiledNoise::apply(View<const float> clean_dn, View<std::uint16_t> raw,
                          const DrawAddress& address, const CameraOutput& camera) const {
  run(PixelRows<const char>(clean_dn), PixelRows<char>(raw), address, camera);
}

void CompiledNoise::apply(View<const std::uint16_t> clean_raw, View<std::uint16_t> raw,
                          const DrawAddress& address, const CameraOutput& camera) const {
  run(PixelRows<const char>(clean_raw), PixelRows<char>(raw), address, camera);
}

void CompiledNoise::apply(View<const std::uint16_t> clean_raw, View<float> noisy_dn,
                          const DrawAddress& address, const CameraOutput& camera) const {
  run(PixelRows<const char>(clean_raw), PixelRows<char>(noisy_dn), address, camera);
}

}  // namespace malus
