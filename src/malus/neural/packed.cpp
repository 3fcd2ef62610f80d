#include "malus/neural/internal/packed.h"

#include "malus/base/error.h"
#include "malus/neural/internal/autocast.h"

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

PackedLinear::PackedLinear(const torch::Tensor& weight, const torch::Tensor& bias, bool gated)
    : inner_(weight.size(1)), cols_(weight.size(0)), gated_(gated) {
  // [outputs, taps, inputs]: the order in which a product meets them.
  torch::Tensor rows =
      weight.detach().to(torch::kFloat).reshape({cols_, inner_, -1}).transpose(1, 2).contiguous();
  if (bias.defined()) bias_ = bias.detach().to(torch::kFloat).contiguous().clone();
  const std::ptrdiff_t panel = gated ? gate_panel(RoundedProducts::wanted()) : 0;
  if (gated) {
    MALUS_REQUIRE(cols_ % (2 * kLane) == 0);
    const auto order = torch::empty({cols_}, torch::kLong);
    for (std::ptrdiff_t n = 0; n < cols_; ++n)
      order.data_ptr<std::int64_t>()[n] = gate_column(n, cols_, panel);
    rows = rows.index_select(0, order);
    if (bias_.defined()) bias_ = bias_.index_select(0, order);
  }
  const std::ptrdiff_t depth = rows.size(1) * inner_;
  if (RoundedProducts::wanted()) {
    packed_ =
        torch::empty({rows.size(1) * whole_pairs(inner_) * whole_lanes(cols_)}, torch::kBFloat16);
    pack_pairs(rows.data_ptr<float>(), rows.size(1), inner_, cols_, 1, depth,
               static_cast<Bfloat16*>(packed_.data_ptr()), panel);
  } else {
    packed_ = torch::empty({depth * whole_lanes(cols_)}, torch::kFloat);
    pack_columns(rows.data_ptr<float>(), depth, cols_, 1, depth, packed_.data_ptr<float>(), panel);
  }
}

MatrixProduct PackedLinear::product() const {
  MatrixProduct product;
  product.inner = inner_;
  product.cols = cols_;
  product.gate = gated_;
  if (rounded())
    product.pairs = static_cast<const Bfloat16*>(packed_.data_ptr());
  else
    product.b = packed_.data_ptr<float>();
  product.bias = bias_.defined() ? bias_.data_ptr<float>() : nullptr;
  return product;
}

void PackedLinear::run(const float* a, std::ptrdiff_t rows, float* c, std::ptrdiff_t c_row,
                       bool add, const float* ahead) const {
  MatrixProduct p = product();
  p.ahead = ahead;
  p.ahead_row = cols_;
  p.rows = rows;
  p.a = a;
  p.a_row = inner_;
  p.c = c;
  p.c_row = c_row;
  p.add = add;
  multiply(p);
}

PackedLinear PackedLinear::with_inputs_scaled(const float* factors) const {
  MALUS_REQUIRE(!gated_ && !rounded());
  PackedLinear scaled = *this;
  scaled.packed_ = torch::empty_like(packed_);
  scale_packed_rows(packed_.data_ptr<float>(), inner_, cols_, factors,
                    scaled.packed_.data_ptr<float>());
  return scaled;
}

NormedLinear::NormedLinear(const RowNorm& norm, const torch::Tensor& weight,
                           const torch::Tensor& bias, bool gated)
    : norm_(norm) {
  const std::int64_t inner = weight.size(1), used = inner - norm.filling;
  const auto owned = [&](const float* values) {
    return torch::constant_pad_nd(torch::from_blob(const_cast<float*>(values), {used}),
                                  {0, norm.filling});
  };
  weight_ = owned(norm.weight);
  if (norm.bias != nullptr) bias_ = owned(norm.bias);
  if (RoundedProducts::wanted()) {
    norm_.weight = weight_.data_ptr<float>();
    norm_.bias = norm.bias == nullptr ? nullptr : bias_.data_ptr<float>();
    linear_ = {weight, bias, gated};
    return;
  }
  const auto plain = weight.detach().flatten(1).to(torch::kDouble);
  auto folded = plain * weight_.to(torch::kDouble);
  if (!norm.bias_free) {
    const auto counted = folded.slice(1, 0, used);
    counted.sub_(counted.mean(1, true));
  }
  auto shift = bias.defined() ? bias.detach().to(torch::kDouble) : torch::Tensor();
  if (bias_.defined()) {
    const auto more = torch::mv(plain, bias_.to(torch::kDouble));
    shift = shift.defined() ? shift + more : more;
  }
  linear_ = {folded, shift, gated};
}

std::ptrdiff_t NormedLinear::memory(std::ptrdiff_t rows, std::ptrdiff_t groups) const {
  return linear_.rounded() ? rows * groups * linear_.inner() : rows * groups + kLane;
}

void NormedLinear::run(const MatrixProduct& where, float* memory) const {
  MatrixProduct p = linear_.product();
  p.rows = where.rows;
  p.groups = where.groups;
  p.c = where.c;
  p.c_row = where.c_row;
  p.c_group = where.c_group;
  p.ahead = where.ahead;
  p.ahead_row = where.ahead_row;
  p.ahead_group = where.ahead_group;
  p.a = linear_.rounded() ? memory : where.a;
  p.a_row = linear_.rounded() ? p.inner : where.a_row;
  p.a_group = linear_.rounded() ? p.rows * p.inner : where.a_group;
  if (!linear_.rounded()) p.row_factors = memory;
  for (std::ptrdiff_t group = 0; group < p.groups; ++group) {
    const float* rows = where.a + group * where.a_group;
    if (linear_.rounded())
      normalize_rows(norm_, rows, where.a_row, p.rows, p.inner, memory + group * p.rows * p.inner);
    else
      inverse_deviations(norm_, rows, where.a_row, p.rows, p.inner, memory + group * p.rows);
  }
  multiply(p);
}

PackedDepthwise::PackedDepthwise(const torch::Tensor& kernel, const torch::Tensor& shift)
    : weight(kernel.detach().reshape({kernel.size(0), 9}).t().contiguous()),
      bias(shift.defined() ? shift.detach().contiguous().clone() : torch::Tensor()) {}

}  // namespace malus::internal
