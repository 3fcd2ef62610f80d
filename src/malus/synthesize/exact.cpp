#include "malus/synthesize/exact.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/noise/tukey_lambda.h"
#include "malus/synthesize/internal/poisson.h"

#include <algorithm>
#include <cmath>
#include <string>

#include <fmt/format.h>

namespace malus {
namespace {

double quantization_of(double step_dn, const PhiloxBlock& block) {
  return step_dn * (uniform_open(block.word[2], block.word[3]) - 0.5);
}

// Block 0 of a pixel serves read and quantisation noise; shot noise takes as many more as it needs.
class ShotUniforms {
 public:
  ShotUniforms(const DrawAddress& address, std::uint64_t index)
      : address_(address), index_(index) {}
  double operator()() {
    if (used_ == 4) {
      block_ = random_block(address_.seed, address_.frame, index_, Draw::kPixel, sub_++);
      used_ = 0;
    }
    used_ += 2;
    return uniform_open(block_.word[used_ - 2], block_.word[used_ - 1]);
  }

 private:
  const DrawAddress& address_;
  std::uint64_t index_;
  std::uint32_t sub_ = 1;
  int used_ = 4;
  PhiloxBlock block_{};
};

void check_channel(const PhysicsChannel& channel, const std::string& name) {
  const auto fail = [&](const char* what, double value) {
    throw InputError("noise parameters", fmt::format("channel {}: {} is {}", name, what, value),
                     "check the noise model with " + command("model show"));
  };
  if (!(channel.gain_dn_per_e > 0 && std::isfinite(channel.gain_dn_per_e)))
    fail("K", channel.gain_dn_per_e);
  if (!(channel.lambda > kNoVarianceLambda && channel.lambda <= kHighestLambda))
    fail("lambda", channel.lambda);
  if (!std::isfinite(channel.mu_dn)) fail("mu", channel.mu_dn);
  if (!(channel.sigma_tl_dn >= 0 && std::isfinite(channel.sigma_tl_dn)))
    fail("sigma_tl", channel.sigma_tl_dn);
  if (!(channel.sigma_row_dn >= 0 && std::isfinite(channel.sigma_row_dn)))
    fail("sigma_row", channel.sigma_row_dn);
}

}  // namespace

void check_physics(const PhysicsNoise& noise) {
  if (static_cast<int>(noise.channels.size()) != noise.layout.channels())
    throw InputError(
        "noise parameters",
        fmt::format("{} for a layout of {}", counted(std::ssize(noise.channels), "channel"),
                    noise.layout.channels()),
        "use the model of this sensor");
  if (noise.row_group < 1)
    throw InputError("noise parameters", fmt::format("row_group is {}", noise.row_group),
                     "declare a row group of 1 or more");
  if (!(noise.quantization_dn >= 0 && std::isfinite(noise.quantization_dn)))
    throw InputError("noise parameters",
                     fmt::format("quantization step is {} DN", noise.quantization_dn),
                     "declare a step of 0 or more");
  if (const std::string problem = contradiction_in(noise.row_drift); !problem.empty())
    throw InputError("noise parameters", "the row drift " + problem,
                     "check the noise model with " + command("model show"));
  for (int c = 0; c < noise.layout.channels(); ++c)
    check_channel(noise.channels[static_cast<std::size_t>(c)], noise.layout.channel_name(c));
}

int require_place(const char* name, std::int64_t start, int size) {
  const std::int64_t last = std::max<std::int64_t>(std::int64_t{kLastPosition} - size + 1, 0);
  if (start < 0 || start > last)
    throw InputError(name, fmt::format("{} is no place on a sensor", start),
                     fmt::format("give 0 to {}", last));
  return static_cast<int>(start);
}

void require_place(const DrawAddress& address, int rows, int cols) {
  require_place("row0", address.row0, rows);
  require_place("col0", address.col0, cols);
}

double row_group_draw(const DrawAddress& address, std::int64_t group) {
  const auto block =
      random_block(address.seed, address.frame, static_cast<std::uint64_t>(group), Draw::kRow);
  return normal_quantile(uniform_open(block.word[0], block.word[1]));
}

std::vector<double> row_deviates(const DrawAddress& address, int rows, int row_group,
                                 const RowDrift& drift) {
  std::vector<double> z(static_cast<std::size_t>(rows));
  if (rows == 0) return z;
  const std::vector<double> kernel = row_kernel(drift);
  const auto before = static_cast<int>(kernel.size()) - 1;
  const int first = address.row0 / row_group, last = (address.row0 + rows - 1) / row_group;
  constexpr std::ptrdiff_t kGroupsPerPiece = 128;
  std::vector<double> draws(static_cast<std::size_t>(last - first + 1 + before));
  parallel_for(0, std::ssize(draws), kGroupsPerPiece,
               [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
                 for (std::ptrdiff_t i = begin; i < end; ++i)
                   draws[static_cast<std::size_t>(i)] =
                       row_group_draw(address, std::int64_t{first} - before + i);
               });
  parallel_for(first, last + 1, kGroupsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (std::ptrdiff_t group = begin; group < end; ++group) {
      const double* newest = &draws[static_cast<std::size_t>(group - first + before)];
      double sum = 0;
      for (int j = 0; j <= before; ++j) sum += kernel[static_cast<std::size_t>(j)] * newest[-j];
      const auto from = std::max<std::ptrdiff_t>(group * row_group - address.row0, 0);
      const auto to = std::min<std::ptrdiff_t>((group + 1) * row_group - address.row0, rows);
      std::fill(z.begin() + from, z.begin() + to, sum);
    }
  });
  return z;
}

double draw_pixel_exact(const PhysicsNoise& noise, int channel, double signal_dn,
                        const DrawAddress& address, int row, int col) {
  if (!std::isfinite(signal_dn)) return signal_dn;
  const PhysicsChannel& p = noise.channels[static_cast<std::size_t>(channel)];
  const std::uint64_t index = pixel_index(row, col);
  double value = signal_dn;
  if (noise.parts.shot && signal_dn > 0) {
    ShotUniforms uniforms(address, index);
    value = p.gain_dn_per_e * poisson_draw(signal_dn / p.gain_dn_per_e, uniforms);
  }
  if (noise.parts.bias) value += p.mu_dn;
  const auto block = random_block(address.seed, address.frame, index, Draw::kPixel);
  if (noise.parts.read)
    value +=
        p.sigma_tl_dn * tukey_lambda_quantile(uniform_open(block.word[0], block.word[1]), p.lambda);
  if (noise.parts.quantization) value += quantization_of(noise.quantization_dn, block);
  return value;
}

void add_noise_exact(const PhysicsNoise& noise, View<const float> clean_dn, View<float> noisy_dn,
                     const DrawAddress& address) {
  check_physics(noise);
  MALUS_REQUIRE(clean_dn.rows() == noisy_dn.rows() && clean_dn.cols() == noisy_dn.cols());
  require_place(address, noisy_dn.rows(), noisy_dn.cols());
  std::vector<double> deviates(static_cast<std::size_t>(clean_dn.rows()), 0.0);
  if (noise.parts.row)
    deviates = row_deviates(address, clean_dn.rows(), noise.row_group, noise.row_drift);
  constexpr std::ptrdiff_t kRowsPerPiece = 8;
  parallel_for(0, clean_dn.rows(), kRowsPerPiece, [&](std::ptrdiff_t begin, std::ptrdiff_t end) {
    for (int r = static_cast<int>(begin); r < end; ++r) {
      const int row = address.row0 + r;
      const double z = deviates[static_cast<std::size_t>(r)];
      for (int c = 0; c < clean_dn.cols(); ++c) {
        const int col = address.col0 + c;
        const int channel = noise.layout.channel_at(row, col);
        const double pixel =
            draw_pixel_exact(noise, channel, double{clean_dn(r, c)}, address, row, col);
        noisy_dn(r, c) = static_cast<float>(
            pixel + z * noise.channels[static_cast<std::size_t>(channel)].sigma_row_dn);
      }
    }
  });
}

}  // namespace malus
