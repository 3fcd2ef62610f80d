// Variance of patches along the directions in which others like them vary least.
#pragma once

#include "malus/base/statistics.h"

#include <cmath>

#include <Eigen/Dense>

namespace malus::internal {

using PatchMatrix = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

inline constexpr int kQuietest = 4;  // directions

/// Of `measured` along the directions in which `choosing` varies least; rows: patches, without
/// their mean. The mean square along them is averaged with what lies above kBoundInMedians medians
/// set back to that; kMeanOfBounded: what noise has then (chi-square of 4 degrees over 4: median
/// 0.8392).
inline double variance_along_quietest(const PatchMatrix& choosing, const PatchMatrix& measured) {
  constexpr double kBoundInMedians = 1.5, kMeanOfBounded = 0.8178;
  const Eigen::MatrixXd power = (choosing.transpose() * choosing).cast<double>();
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(power);
  const Eigen::MatrixXf directions = solver.eigenvectors().leftCols(kQuietest).cast<float>();
  const Eigen::VectorXf means = (measured * directions).rowwise().squaredNorm() / kQuietest;
  const double bound = kBoundInMedians * median_of({means.begin(), means.end()});
  return means.cast<double>().cwiseMin(bound).mean() / kMeanOfBounded;
}

/// Of two sets of patches that choose for each other: a set's own quietest directions would flatter
/// it.
inline double quietest_variance(const PatchMatrix& first, const PatchMatrix& second) {
  return 0.5 * (variance_along_quietest(first, second) + variance_along_quietest(second, first));
}

/// One standard error of it, from this many patches; bounding costs a tenth.
inline double quietest_error(double patches) { return 1.1 * std::sqrt(2.0 / kQuietest / patches); }

}  // namespace malus::internal
