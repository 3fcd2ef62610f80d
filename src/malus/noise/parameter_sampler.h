// Random parameters of frames at one gain (000 Eq. 5-6), with everything that does not change from
// frame to frame worked out once.
#pragma once

#include "malus/base/random.h"
#include "malus/noise/joint_gain.h"
#include "malus/noise/matrix.h"
#include "malus/noise/model.h"

#include <cstdint>
#include <span>
#include <vector>

namespace malus {

/// Draws of N(mean, covariance) for one covariance. Negative eigenvalues, which only rounding or
/// sampling error can cause, count as zero.
class GaussianSampler {
 public:
  explicit GaussianSampler(const SquareMatrix& covariance);
  /// n normals from the sequence. Contract: as many means as the covariance has rows.
  std::vector<double> draw(std::span<const double> mean, RandomSequence& random) const;

 private:
  SquareMatrix root_;  ///< eigenvectors times the roots of their eigenvalues
};

/// Noise can be drawn with them: all numbers are finite and K is above 0. Laws over gain may give
/// others, far from the gains that they were fitted to.
bool are_possible(const GainParameters& parameters);

class ParameterSampler {
 public:
  /// Parameters as NoiseModel::parameters_at gives them.
  ParameterSampler(const NoiseModel& model, GainParameters parameters);

  /// What NoiseModel::sample_physics_at returns for the frame.
  PhysicsNoise draw(std::uint64_t seed, std::uint32_t frame) const;
  /// What NoiseModel::physics_at returns.
  const PhysicsNoise& mean() const { return mean_; }

 private:
  GainParameters parameters_;
  PhysicsNoise mean_;
  GaussianSampler mu_, sigma_row_;
};

}  // namespace malus
