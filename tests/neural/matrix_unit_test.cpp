// Products in the processor's matrix unit against those of its vectors, which other tests compare
// with plain sums: the same rounded values, so only the order of float32 sums differs.
#include "malus/neural/internal/matrix_unit.h"

#include <cmath>
#include <utility>
#include <vector>

#include "support.h"
#include <gtest/gtest.h>
#include <torch/torch.h>

namespace malus {
namespace {

using internal::MatrixProduct;

// What a product is of, and which of its choices it takes.
struct Shape {
  std::int64_t groups, rows, inner, cols, taps;
  bool gate = false, bias = true, add = false, factors = false;
  float leak = 1;
};

std::vector<internal::Bfloat16> packed_weights(const Shape& s) {
  const auto b = torch::randn({s.taps * s.inner, s.cols});
  std::vector<internal::Bfloat16> packed(static_cast<std::size_t>(
      s.taps * internal::whole_pairs(s.inner) * internal::whole_lanes(s.cols)));
  internal::pack_pairs(b.data_ptr<float>(), s.taps, s.inner, s.cols, s.cols, 1, packed.data(),
                       s.gate ? internal::gate_panel(true) : 0);
  return packed;
}

// Of vectors and of the unit.
std::pair<torch::Tensor, torch::Tensor> both_products(const Shape& s) {
  const std::int64_t reach = s.rows + s.taps, given = s.gate ? s.cols / 2 : s.cols,
                     c_row = given + 3;
  const auto a = torch::randn({s.groups, reach, s.inner}), bias = torch::randn({s.cols}),
             factors = torch::rand({s.groups * s.rows}) + 0.5;
  const auto packed = packed_weights(s);
  std::vector<std::ptrdiff_t> taps;
  for (std::int64_t t = 0; t < s.taps; ++t) taps.push_back(t * s.inner);
  MatrixProduct p{.rows = s.rows, .inner = s.inner, .cols = s.cols, .a = a.data_ptr<float>()};
  p.a_row = s.inner;
  if (s.taps > 1) p.taps = taps;
  p.pairs = packed.data();
  p.bias = s.bias ? bias.data_ptr<float>() : nullptr;
  p.row_factors = s.factors ? factors.data_ptr<float>() : nullptr;
  p.c_row = c_row;
  p.groups = s.groups;
  p.a_group = reach * s.inner;
  p.c_group = s.rows * c_row;
  p.add = s.add;
  p.gate = s.gate;
  p.leak = s.leak;
  const auto start = torch::randn({s.groups * s.rows, c_row});
  auto by_vectors = start.clone(), in_unit = start.clone();
  p.c = by_vectors.data_ptr<float>();
  internal::multiply_rounded(p, false);
  p.c = in_unit.data_ptr<float>();
  internal::multiply_rounded(p, true);
  // Nothing beside the product may be touched.
  EXPECT_TRUE(torch::equal(in_unit.slice(1, given), start.slice(1, given)));
  return {by_vectors, in_unit};
}

// Rows that fill no tile, inner sizes that fill no step and that need several parts, columns that
// fill no tile, panels of three and of four tiles.
TEST(MatrixUnit, AgreesWithVectors) {
  if (!internal::has_matrix_unit()) GTEST_SKIP() << "this processor has no matrix unit";
  torch::manual_seed(12);
  for (const Shape& shape : {Shape{1, 1, 1, 1, 1},
                             {1, 16, 32, 16, 1},
                             {1, 33, 31, 20, 1},
                             {3, 47, 48, 48, 1},
                             {2, 70, 100, 112, 1},
                             {1, 32, 1100, 64, 1},
                             {2, 17, 2100, 100, 1},
                             {2, 40, 16, 64, 9},
                             {3, 19, 65, 50, 9},
                             {1, 35, 300, 96, 9}})
    for (const bool bias : {false, true})
      for (const bool add : {false, true})
        for (const float leak : {1.0F, 0.2F})
          for (const bool factors : {false, true}) {
            if (add && factors) continue;
            Shape s = shape;
            s.bias = bias, s.add = add, s.leak = leak, s.factors = factors;
            const auto [vectors, unit] = both_products(s);
            EXPECT_LT((unit - vectors).abs().max().item<double>(),
                      5e-7 * static_cast<double>(s.taps * s.inner + 10))
                << s.groups << " x " << s.rows << " x " << s.inner << " x " << s.cols << ", "
                << s.taps << " taps, bias " << bias << ", add " << add << ", leak " << leak
                << ", factors " << factors;
          }
}

TEST(MatrixUnit, GatesAgreeWithVectors) {
  if (!internal::has_matrix_unit()) GTEST_SKIP() << "this processor has no matrix unit";
  torch::manual_seed(13);
  for (const Shape& shape : {Shape{1, 1, 1, 32, 1, true},
                             {2, 37, 48, 96, 1, true},
                             {1, 64, 64, 128, 1, true},
                             {2, 50, 1200, 160, 1, true}})
    for (const bool bias : {false, true}) {
      Shape s = shape;
      s.bias = bias;
      const auto [vectors, unit] = both_products(s);
      EXPECT_LT((unit - vectors).abs().max().item<double>(),
                2e-6 * static_cast<double>(s.inner + 10) * std::sqrt(static_cast<double>(s.inner)))
          << s.rows << " x " << s.inner << " x " << s.cols;
    }
}

}  // namespace
}  // namespace malus
