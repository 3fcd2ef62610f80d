#include "malus/calibrate/warnings_of_gains.h"

#include <algorithm>
#include <utility>

namespace malus {
namespace {

// What the calibration of one kind warned about: one line where gains share it.
template <class Calibration>
void append_warnings(const std::vector<Calibration>& gains, const std::string& kind,
                     std::vector<std::string>& lines) {
  std::vector<std::pair<std::string, std::vector<GainSetting>>> said;  // the gains of every text
  for (const Calibration& gain : gains)
    for (const std::string& warning : gain.warnings) {
      auto same = std::ranges::find_if(said, [&](const auto& s) { return s.first == warning; });
      if (same == said.end()) same = said.insert(said.end(), {warning, {}});
      same->second.push_back(gain.gain);
    }
  for (const auto& [warning, of] : said) lines.push_back(gain_prefix(of, kind) + warning);
}

}  // namespace

std::vector<std::string> warnings_of_gains(const NoiseModel& model) {
  std::vector<std::string> lines;
  append_warnings(model.physics, "", lines);
  append_warnings(model.gaussian, "Gaussian", lines);
  append_warnings(model.nonparametric, "non-parametric", lines);
  return lines;
}

}  // namespace malus
