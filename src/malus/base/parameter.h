// A setting is declared once and feeds the command-line flag, the configuration file, the JSON,
// Python and the report. So is what a result tells (Denoised): it feeds the JSON and Python.
//
//   struct DenoiseSettings {
//     double strength = 1.0;
//     template <class Self, class Visitor>
//     static void describe(Self& self, Visitor&& field) {   // Self is const or not
//       field(self.strength, ParameterInfo{"strength", "1", "multiplies sigma", 0.0, 10.0});
//     }
//   };
//
// Field types: bool, int, double, std::string, std::vector<double>, and std::optional of these; of
// results std::int64_t, too.
#pragma once

#include <limits>
#include <string>
#include <vector>

namespace malus {

struct ParameterInfo {
  std::string name;  ///< words joined by '_'; the flag is --name with '-'
  std::string unit;  ///< "1" for pure numbers, "" for text and switches
  std::string help;  ///< one line, no full stop
  double minimum = -std::numeric_limits<double>::infinity();
  double maximum = std::numeric_limits<double>::infinity();
  std::vector<std::string> choices = {};  ///< for text: the allowed values; empty = any
};

}  // namespace malus
