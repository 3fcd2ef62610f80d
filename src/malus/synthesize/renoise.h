// Noise on noise (001, S6): a noisy frame taken at one gain made to look like one taken at a
// noisier gain, without knowing the clean picture.
//
// Per channel and signal level a distribution d is found with p1 * d = p2 (non-negative
// deconvolution of the noise distributions at the two gains), and a draw of d is added to the noisy
// pixel. A denoised picture only says which level a pixel has: details that the denoiser lost stay,
// because they are in the noisy pixel. The literal reading of 001's Algorithm S1, I + n2 - n1 with
// n1 = noisy - denoised, is the naive scheme denoised + n2.
#pragma once

#include "malus/image/view.h"
#include "malus/noise/calibration.h"
#include "malus/noise/physics.h"
#include "malus/synthesize/exact.h"
#include "malus/synthesize/level_sampler.h"

#include <vector>

namespace malus {

/// d >= 0, sum 1, with p1 * d = p2 as closely as Kullback-Leibler divergence can have it
/// (Richardson-Lucy; Shepp and Vardi, IEEE Trans. Med. Imag. 1, 1982). p1 and p2 lie on the same
/// bins; d has 2 n - 1 bins, of which the middle one, n - 1, is "no change".
std::vector<double> deconvolve(const std::vector<double>& p1, const std::vector<double>& p2,
                               int iterations = 300);

/// One channel's noise on equal bins.
class PixelBins {
 public:
  /// Tables the read noise's distribution function: a few milliseconds.
  PixelBins(const PhysicsNoise& noise, int channel);
  /// Probabilities of `bins` bins of noisy - signal, of width_dn, centred on zero; what lies
  /// outside counts to the end bins. Error < 1e-5.
  std::vector<double> probabilities(double signal_dn, double width_dn, int bins) const;

 private:
  double read_cdf(double x_dn) const;

  PhysicsChannel channel_;
  PhysicsParts parts_;
  double quantization_dn_, reach_dn_;
  std::vector<double> read_cdf_;  ///< at equal steps from -reach_dn_ to reach_dn_
};

/// The address that second noise is drawn at: a frame synthesized under the same seed and number
/// must not meet the same random words again, or the two noises would be correlated.
DrawAddress second_noise(const DrawAddress& address);

class Renoiser {
 public:
  /// Both at one sensor, with any levels and bins: the distributions are taken at common signals,
  /// on common bins. white_dn: largest signal, DN above black; beyond the levels that both gains
  /// have it is reached where both know K, else the outermost added noise goes on. quantization_dn:
  /// step that the result is rounded to, which both distributions hold already; 0: it is not.
  /// Throws InputError where the target is quieter than the source at some level (nothing can be
  /// added to get there), and where the gains have no level in common.
  Renoiser(const SensorLayout& layout, const NonparametricCalibration& from,
           const NonparametricCalibration& to, int row_group, double white_dn,
           double quantization_dn);
  /// From physics noise at the two gains; white_dn: largest signal, DN above black.
  Renoiser(const PhysicsNoise& from, const PhysicsNoise& to, double white_dn);

  /// renoised = noisy + a draw of d at the guide's level, at second_noise(address). All DN above
  /// black; in place if wanted.
  void apply(View<const float> noisy_dn, View<const float> guide_dn, View<float> renoised_dn,
             const DrawAddress& address) const;

 private:
  LevelSampler sampler_;
};

}  // namespace malus
