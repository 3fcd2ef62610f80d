// Axes of many stacks at once against a solver in double precision.
#include "malus/base/random.h"
#include "malus/denoise/internal/stack_kernel.h"

#include <cmath>

#include <Eigen/Eigenvalues>
#include <gtest/gtest.h>

namespace malus::internal {
namespace {

using SixteenSquare = Eigen::Matrix<double, kLanes, kLanes>;

SixteenSquare doubles_of(const CellMatrix& m) {
  SixteenSquare result;
  for (int i = 0; i < kLanes; ++i)
    for (int k = 0; k < kLanes; ++k)
      result(i, k) = m[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)];
  return result;
}

// As stacks have them: one strong direction, fainter ones, and noise in all.
CellMatrix moments_of(double light, std::uint64_t seed) {
  RandomSequence random(seed, 0, Draw::kOther);
  SixteenSquare directions, energies = SixteenSquare::Zero();
  for (int i = 0; i < kLanes; ++i)
    for (int k = 0; k < kLanes; ++k) directions(i, k) = random.normal();
  for (int k = 0; k < kLanes; ++k) energies(k, k) = 0.2 + light * std::pow(0.3, k);
  const SixteenSquare moments = directions * energies * directions.transpose();
  CellMatrix result;
  for (int i = 0; i < kLanes; ++i)
    for (int k = 0; k < kLanes; ++k)
      result[static_cast<std::size_t>(i)][static_cast<std::size_t>(k)] =
          static_cast<float>(moments(i, k));
  return result;
}

// Orthonormal axes, the strongest first, with nearly nothing in common. moments: of up to kLanes
// stacks.
void expect_principal_axes(const std::vector<CellMatrix>& moments) {
  std::vector<CellMatrix> all(moments.size());
  axes_of_stacks(moments.data(), static_cast<int>(moments.size()), all.data());
  for (std::size_t n = 0; n < moments.size(); ++n) {
    const SixteenSquare axes = doubles_of(all[n]), m = doubles_of(moments[n]);
    const Eigen::SelfAdjointEigenSolver<SixteenSquare> solver(m);
    const double largest = solver.eigenvalues().maxCoeff();
    EXPECT_LT((axes.transpose() * axes - SixteenSquare::Identity()).cwiseAbs().maxCoeff(), 1e-5);
    const SixteenSquare expected = solver.eigenvalues().reverse().asDiagonal();
    EXPECT_LE((axes.transpose() * m * axes - expected).cwiseAbs().maxCoeff(), 2e-4 * largest)
        << "stack " << n;
  }
}

TEST(StackAxes, ArePrincipalAxes) {
  for (const double light : {0.0, 1.0, 100.0, 1e6}) {
    std::vector<CellMatrix> moments;
    for (std::uint64_t n = 0; n < kLanes; ++n) moments.push_back(moments_of(light, n));
    expect_principal_axes(moments);
  }
}

TEST(StackAxes, OfFewStacksAndOfNothing) {
  expect_principal_axes({moments_of(1, 1), CellMatrix{}, moments_of(30, 2)});
}

TEST(StackAxes, DoNotDependOnTheOtherStacks) {
  const std::vector<CellMatrix> both = {moments_of(1, 1), moments_of(30, 2)};
  CellMatrix together[2], alone;
  axes_of_stacks(both.data(), 2, together);
  axes_of_stacks(&both[1], 1, &alone);
  EXPECT_EQ(alone, together[1]);
}

}  // namespace
}  // namespace malus::internal
