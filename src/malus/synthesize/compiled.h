// A noise model at one gain, compiled to tables: the same distribution as exact.h draws, tens of
// times faster. One 64-bit pair of random words per pixel, no transcendental function, the same
// bytes for any instruction set, thread count, tile and crop.
//
// How: shot noise is drawn as whole electrons, by summing probabilities below 5 electrons and by
// the asymptotic inverse of the Poisson distribution above; read noise by its quantile function in
// 2049 cells (quantile_table.h); quantisation from the low bits of the shot word; row noise once
// per row group (row_deviates in exact.h, the same for both). formation-inl.h holds the lines of
// one pixel.
#pragma once

#include "malus/image/view.h"
#include "malus/noise/physics.h"
#include "malus/synthesize/exact.h"
#include "malus/synthesize/formation.h"

#include <cstdint>
#include <memory>
#include <vector>

namespace malus {

/// Heteroscedastic Gaussian noise of one channel: variance = slope_dn max(s, 0) + offset_dn2,
/// clamped at zero.
struct GaussianChannel {
  double slope_dn = 0, offset_dn2 = 0, sigma_row_dn = 0, mu_dn = 0;
};

/// How a uint16 raw is written: black back, rounding to the step, clipping only here.
struct CameraOutput {
  std::vector<double> black_dn;  ///< one per channel
  double white_dn = 65535;       ///< black included
  double step_dn = 1;            ///< 0: of a model whose frames no converter rounded
  /// What is written is whole numbers all the same.
  double whole_step_dn() const { return step_dn > 0 ? step_dn : 1.0; }
};

/// One channel's numbers in the sampler's precision.
struct CompiledChannel {
  float gain_dn = 1;           ///< K; of kGaussian the slope S
  float electrons_per_dn = 1;  ///< 1/K
  float variance_dn2 = 0;      ///< of kGaussian: O
  float scale_dn = 0;          ///< read noise per unit of its table
  float mu_dn = 0, sigma_row_dn = 0;
  std::uint32_t first_line = 0;  ///< of the channel's table among the read lines
};

/// Everything that a twin of the kernel needs.
struct CompiledParts {
  SensorLayout layout;
  std::vector<CompiledChannel> channels;
  /// kTailCells lines per distinct shape, shared by copies; null: no read noise.
  std::shared_ptr<const std::vector<TailLine>> read_lines;
  ShotKind shot = ShotKind::kPoisson;
  bool row_noise = true;
  int row_group = 1;
  RowDrift row_drift;
  float quantization_dn = 0;
};

class CompiledNoise {
 public:
  /// Throws InputError as check_physics does. About 0.01 ms per distinct lambda.
  explicit CompiledNoise(const PhysicsNoise& noise);

  /// Poisson-Gaussian: the physics model with a normal distribution of the same variance instead of
  /// the Tukey-lambda.
  static CompiledNoise poisson_gaussian(const PhysicsNoise& noise);
  /// Heteroscedastic Gaussian; row_group rows share one draw of row noise. quantization_dn: step of
  /// uniform noise to add, 0 where the calibrated variance already holds it.
  static CompiledNoise gaussian(const SensorLayout& layout,
                                const std::vector<GaussianChannel>& channels, int row_group,
                                double quantization_dn = 0);

  /// Other parameters of physics or Poisson-Gaussian noise on the same tables: as compiling `noise`
  /// anew, without the cost. Contract: the layout, the lambdas and parts.read are those that this
  /// was compiled with.
  CompiledNoise with_parameters(const PhysicsNoise& noise) const;
  /// The same without uniform quantisation noise: for output that is rounded later.
  CompiledNoise without_quantization() const;

  /// DN above black in, DN above black out, nothing rounded or clamped. Contract: equal sizes;
  /// noisy_dn may be clean_dn.
  void apply(View<const float> clean_dn, View<float> noisy_dn, const DrawAddress& address) const;
  /// The same, written as the camera would: rounding replaces the uniform quantisation noise.
  void apply(View<const float> clean_dn, View<std::uint16_t> raw, const DrawAddress& address,
             const CameraOutput& camera) const;
  /// Raw in (black included), raw out.
  void apply(View<const std::uint16_t> clean_raw, View<std::uint16_t> raw,
             const DrawAddress& address, const CameraOutput& camera) const;
  /// Raw in (black included), DN above black out; only camera.black_dn is used.
  void apply(View<const std::uint16_t> clean_raw, View<float> noisy_dn, const DrawAddress& address,
             const CameraOutput& camera) const;

  const CompiledParts& parts() const { return parts_; }

 private:
  CompiledNoise() = default;
  template <class Byte>
  struct PixelRows;
  void run(const PixelRows<const char>& in, const PixelRows<char>& out, const DrawAddress& address,
           const CameraOutput& camera) const;
  void use_physics(const PhysicsNoise& noise);
  void make_read_lines(const PhysicsNoise& noise);

  CompiledParts parts_;
  bool gaussian_read_ = false;
};

}  // namespace malus
