#include "malus/neural/internal/packed.h"

#include "malus/base/error.h"
#include "malus/neural/autocast.h"

namespace malus::internal {
namespace {

thread_local bool rounded_products = false;

}  // namespace

RoundedProducts::RoundedProducts(bool wanted) : before_(rounded_products) {
  rounded_products = wanted && can_round_products();
}
RoundedProducts::~RoundedProducts() { rounded_products = before_; }
bool RoundedProducts::wanted() { return rounded_products; }

bool kernels_apply(const torch::Tensor& x) {
  return !torch::GradMode::is_enabled() && x.device().is_cpu() &&
         x.scalar_type() == torch::kFloat && !cpu_layers_are_rounded();
}

Scratch::Scratch(std::ptrdiff_t values) : memory_(torch::empty({values}, torch::kFloat)) {}

float* Scratch::take(std::ptrdiff_t values) {
  float* part = memory_.data_ptr<float>() + used_;
  used_ += whole_lanes(values);
  MALUS_REQUIRE(used_ <= memory_.numel());
  return part;
}

PackedLinear::PackedLinear(const torch::Tensor& weight, const torch::Tensor& bias)
    : inner_(weight.size(1)), cols_(weight.size(0)) {
  // [outputs, taps, inputs]: the order in which a product meets them.
  const torch::Tensor rows =
      weight.detach().to(torch::kFloat).reshape({cols_, inner_, -1}).transpose(1, 2).contiguous();
  const std::ptrdiff_t depth = rows.size(1) * inner_;
  if (RoundedProducts::wanted()) {
    packed_ =
        torch::empty({rows.size(1) * whole_pairs(inner_) * whole_lanes(cols_)}, torch::kBFloat16);
    pack_pairs(rows.data_ptr<float>(), rows.size(1), inner_, cols_, 1, depth,
               static_cast<Bfloat16*>(packed_.data_ptr()));
  } else {
    packed_ = torch::empty({depth * whole_lanes(cols_)}, torch::kFloat);
    pack_columns(rows.data_ptr<float>(), depth, cols_, 1, depth, packed_.data_ptr<float>());
  }
  if (bias.defined()) bias_ = bias.detach().to(torch::kFloat).contiguous().clone();
}

MatrixProduct PackedLinear::product() const {
  MatrixProduct product;
  product.inner = inner_;
  product.cols = cols_;
  if (packed_.scalar_type() == torch::kBFloat16)
    product.pairs = static_cast<const Bfloat16*>(packed_.data_ptr());
  else
    product.b = packed_.data_ptr<float>();
  product.bias = bias_.defined() ? bias_.data_ptr<float>() : nullptr;
  return product;
}

void PackedLinear::run(const float* a, std::ptrdiff_t rows, float* c, std::ptrdiff_t c_row,
                       bool add) const {
  MatrixProduct p = product();
  p.rows = rows;
  p.a = a;
  p.a_row = inner_;
  p.c = c;
  p.c_row = c_row;
  p.add = add;
  multiply(p);
}

PackedDepthwise::PackedDepthwise(const torch::Tensor& kernel, const torch::Tensor& shift)
    : weight(kernel.detach().reshape({kernel.size(0), 9}).t().contiguous()),
      bias(shift.defined() ? shift.detach().contiguous().clone() : torch::Tensor()) {}

}  // namespace malus::internal
