#include "malus/evaluate/noise_comparison.h"

#include <string>
#include <utility>

#include <fmt/format.h>

namespace malus {

std::vector<Quantity> quantities_of(const NoiseComparison& c) {
  const auto scalar = [](const char* name, const char* symbol, const char* unit,
                         const char* description, double value) {
    return Quantity{name, symbol, unit, description, {value}};
  };
  const auto list = [](const std::string& name, const char* symbol, const char* unit,
                       const char* description, const std::vector<double>& value) {
    return Quantity{name, symbol, unit, description, value};
  };
  std::vector<Quantity> all = {
      scalar("kld", "D(Q||P)", "nat", "Kullback-Leibler divergence of test from reference",
             c.pooled.kld_nats),
      scalar("jsd", "JSD", "bit", "Jensen-Shannon divergence, base 2", c.pooled.jsd_bits),
      scalar("sqrt_jsd", "√JSD", "1", "its root, as in the figures of 001", c.pooled.sqrt_jsd),
      scalar("sqrt_jsd_floor", "√JSD floor", "1", "expected for two samples of one distribution",
             c.pooled.sqrt_jsd_floor)};
  for (const auto& [side, s] : {std::pair{"reference", &c.reference}, {"test", &c.test}}) {
    const std::string suffix = fmt::format("_{}", side);
    all.push_back(list("mean" + suffix, "μ", "DN", "mean per channel", s->mean_dn));
    all.push_back(list("sd" + suffix, "σ", "DN", "standard deviation per channel", s->sd_dn));
    all.push_back(list("sigma_row" + suffix, "σ_b", "DN", "row noise per channel", s->row_sd_dn));
    all.push_back(
        list("sigma_column" + suffix, "σ_c", "DN", "column noise per channel", s->column_sd_dn));
    all.push_back(list("row_power" + suffix, "P_b", "DN^2",
                       "power of the rows' means in eight bands, low to high frequency",
                       s->row_power_dn2));
    all.push_back(list("correlation_along_row" + suffix, "ρ", "1",
                       "correlation of pixels 1, 2, ... apart in a row", s->along_row));
    all.push_back(list("correlation_along_column" + suffix, "ρ", "1",
                       "correlation of pixels 1, 2, ... apart in a column", s->along_column));
    all.push_back(list("correlation_between_frames" + suffix, "ρ", "1",
                       "correlation of a pixel in a frame and in the next", {s->between_frames}));
  }
  return all;
}

}  // namespace malus
