// The log of a training run: one JSON object per line, readable while the run goes on.
#pragma once

#include <cstdint>
#include <filesystem>
#include <fstream>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus {

class TrainingLog {
 public:
  /// Keeps the lines of an earlier part of the run whose step is at most last_step (a killed run
  /// may have written more than its checkpoint knows), drops the others. Throws InputError.
  TrainingLog(const std::filesystem::path& path, std::int64_t last_step);
  /// Contract: line has a "step".
  void write(const nlohmann::ordered_json& line);
  /// All lines, those kept included.
  const std::vector<nlohmann::ordered_json>& lines() const { return lines_; }

 private:
  std::vector<nlohmann::ordered_json> lines_;
  std::filesystem::path path_;
  std::ofstream out_;
};

}  // namespace malus
