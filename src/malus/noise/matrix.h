// Small square matrices over channels, and what the joint model does with covariances.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

namespace malus {

/// n x n, row-major; n = 0 means "not measured".
struct SquareMatrix {
  int n = 0;
  std::vector<double> values;
  SquareMatrix() = default;
  explicit SquareMatrix(int size)
      : n(size), values(static_cast<std::size_t>(size) * static_cast<std::size_t>(size)) {}
  static SquareMatrix identity(int size);
  double& operator()(int r, int c) { return values[index(r, c)]; }
  double operator()(int r, int c) const { return values[index(r, c)]; }
  bool operator==(const SquareMatrix&) const = default;

 private:
  std::size_t index(int r, int c) const {
    return static_cast<std::size_t>(r) * static_cast<std::size_t>(n) + static_cast<std::size_t>(c);
  }
};

/// Correlations of a symmetric covariance. A channel whose variance is not positive has no
/// correlation: zero off the diagonal. Values beyond ±1, which sampling error can cause, stay.
SquareMatrix correlation_of(const SquareMatrix& covariance);

/// diag(sd) R diag(sd).
SquareMatrix covariance_of(const SquareMatrix& correlation, std::span<const double> deviation);

/// Negative eigenvalues set to zero: the nearest positive semi-definite matrix in the Frobenius
/// norm (Higham, Linear Algebra Appl. 103, 1988, Theorem 2.1).
SquareMatrix nearest_semidefinite(const SquareMatrix& symmetric);

/// The correlation matrix (unit diagonal, positive semi-definite) nearest to a symmetric matrix in
/// the Frobenius norm: alternating projections with Dykstra's correction (Higham, IMA J. Numer.
/// Anal. 22, 2002, algorithm 3.3). A matrix that is one already returns unchanged to 1e-12.
SquareMatrix nearest_correlation(const SquareMatrix& symmetric);

/// Largest absolute difference of two matrices of one size.
double largest_difference(const SquareMatrix& a, const SquareMatrix& b);

}  // namespace malus
