#include "malus/neural/training_log.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"

#include <string>

namespace malus {

using OrderedJson = nlohmann::ordered_json;

TrainingLog::TrainingLog(const std::filesystem::path& path, std::int64_t last_step) : path_(path) {
  std::string kept;
  std::ifstream in(path);
  for (std::string text; std::getline(in, text);) {
    const OrderedJson line = OrderedJson::parse(text, nullptr, false);
    if (!line.is_object() || line.value("step", last_step + 1) > last_step) continue;
    kept += text + "\n";
    lines_.push_back(line);
  }
  write_file(path, kept, true);
  out_.open(path, std::ios::app);
}

void TrainingLog::write(const OrderedJson& line) {
  lines_.push_back(line);
  out_ << line.dump() << std::endl;
  if (!out_) throw InputError(path_.string(), "cannot be written", "check the disk, then --resume");
}

}  // namespace malus
