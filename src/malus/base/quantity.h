// A measured value that knows its name, symbol, unit and error: from here the tables, the JSON and
// the report are made.
#pragma once

#include <string>
#include <vector>

namespace malus {

/// One result, scalar or per channel. `value` and `standard_error` have the same length (one per
/// channel, in mosaic order; a scalar has length 1); `standard_error` is empty where none is known.
struct Quantity {
  std::string name;         ///< key in JSON: lower-case words joined by '_'
  std::string symbol;       ///< as in the papers: K, μ, σ_b
  std::string unit;         ///< DN, DN/e-, e-, dB, deg, s; "1" for pure numbers
  std::string description;  ///< one line
  std::vector<double> value;
  std::vector<double> standard_error = {};
};

}  // namespace malus
