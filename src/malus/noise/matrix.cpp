#include "malus/noise/matrix.h"

#include "malus/base/error.h"
#include "malus/noise/parameter_sampler.h"

#include <algorithm>
#include <cmath>

#include <Eigen/Dense>

namespace malus {
namespace {

using Matrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Matrix to_eigen(const SquareMatrix& m) {
  return Eigen::Map<const Matrix>(m.values.data(), m.n, m.n);
}

SquareMatrix from_eigen(const Matrix& m) {
  SquareMatrix out(static_cast<int>(m.rows()));
  Eigen::Map<Matrix>(out.values.data(), out.n, out.n) = m;
  return out;
}

Matrix positive_part(const Matrix& symmetric) {
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(symmetric);
  const Eigen::VectorXd kept = eigen.eigenvalues().cwiseMax(0.0);
  return eigen.eigenvectors() * kept.asDiagonal() * eigen.eigenvectors().transpose();
}

}  // namespace

SquareMatrix SquareMatrix::identity(int size) {
  SquareMatrix m(size);
  for (int i = 0; i < size; ++i) m(i, i) = 1.0;
  return m;
}

SquareMatrix correlation_of(const SquareMatrix& covariance) {
  const int n = covariance.n;
  SquareMatrix r = SquareMatrix::identity(n);
  for (int i = 0; i < n; ++i)
    for (int j = 0; j < n; ++j) {
      if (i == j || covariance(i, i) <= 0 || covariance(j, j) <= 0) continue;
      r(i, j) = covariance(i, j) / std::sqrt(covariance(i, i) * covariance(j, j));
    }
  return r;
}

SquareMatrix covariance_of(const SquareMatrix& correlation, std::span<const double> deviation) {
  MALUS_REQUIRE(correlation.n == static_cast<int>(deviation.size()));
  SquareMatrix covariance = correlation;
  for (int i = 0; i < covariance.n; ++i)
    for (int j = 0; j < covariance.n; ++j)
      covariance(i, j) *=
          deviation[static_cast<std::size_t>(i)] * deviation[static_cast<std::size_t>(j)];
  return covariance;
}

SquareMatrix nearest_semidefinite(const SquareMatrix& symmetric) {
  return from_eigen(positive_part(to_eigen(symmetric)));
}

SquareMatrix nearest_correlation(const SquareMatrix& symmetric) {
  constexpr int kMaxSweeps = 2000;
  constexpr double kTolerance = 1e-13;
  Matrix y = to_eigen(symmetric);
  y = (0.5 * (y + y.transpose())).eval();
  y.diagonal().setOnes();
  Matrix correction = Matrix::Zero(y.rows(), y.cols());
  for (int sweep = 0; sweep < kMaxSweeps; ++sweep) {
    const Matrix shifted = y - correction;
    const Matrix x = positive_part(shifted);
    correction = x - shifted;
    Matrix next = x;
    next.diagonal().setOnes();
    const double change = (next - y).cwiseAbs().maxCoeff();
    y = next;
    if (change < kTolerance) break;
  }
  // The last projection set the diagonal: shrink by what that left below zero.
  const double lowest =
      Eigen::SelfAdjointEigenSolver<Matrix>(y, Eigen::EigenvaluesOnly).eigenvalues()(0);
  if (lowest < 0) {
    y /= 1.0 - lowest;
    y.diagonal().setOnes();
  }
  return from_eigen(y);
}

double largest_difference(const SquareMatrix& a, const SquareMatrix& b) {
  MALUS_REQUIRE(a.n == b.n);
  double largest = 0;
  for (std::size_t i = 0; i < a.values.size(); ++i)
    largest = std::max(largest, std::abs(a.values[i] - b.values[i]));
  return largest;
}

GaussianSampler::GaussianSampler(const SquareMatrix& covariance) : root_(covariance.n) {
  if (covariance.n == 0) return;
  const Eigen::SelfAdjointEigenSolver<Matrix> eigen(to_eigen(covariance));
  const Eigen::VectorXd roots = eigen.eigenvalues().cwiseMax(0.0).cwiseSqrt();
  root_ = from_eigen(eigen.eigenvectors() * roots.asDiagonal());
}

std::vector<double> GaussianSampler::draw(std::span<const double> mean,
                                          RandomSequence& random) const {
  MALUS_REQUIRE(root_.n == static_cast<int>(mean.size()));
  std::vector<double> draw(mean.begin(), mean.end());
  for (int j = 0; j < root_.n; ++j) {
    const double z = random.normal();
    for (int i = 0; i < root_.n; ++i) draw[static_cast<std::size_t>(i)] += root_(i, j) * z;
  }
  return draw;
}

}  // namespace malus
