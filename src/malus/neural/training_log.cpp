#include "malus/neural/internal/training_log.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/wording.h"

#include <string>

namespace malus {

using OrderedJson = nlohmann::ordered_json;

TrainingLog::TrainingLog(const std::filesystem::path& path, std::int64_t last_step) : path_(path) {
  std::string kept;
  std::ifstream in(path);
  for (std::string text; std::getline(in, text);) {
    const OrderedJson line = OrderedJson::parse(text, nullptr, false);
    // A line that is none of ours, or was cut off by a kill, is dropped.
    if (!line.is_object() || !line.contains("step") || !line["step"].is_number_integer()) continue;
    if (line["step"].get<std::int64_t>() > last_step) continue;
    kept += text + "\n";
    lines_.push_back(line);
  }
  write_file(path, kept, true);
  out_.open(path, std::ios::app);
}

void TrainingLog::write(const OrderedJson& line) {
  lines_.push_back(line);
  out_ << line.dump() << std::endl;
  if (!out_)
    throw InputError(path_.string(), "cannot be written",
                     "check the disk, then " + setting("resume", true));
}

}  // namespace malus
