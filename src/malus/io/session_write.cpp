#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/session.h"

#include <system_error>

#include <fmt/format.h>
#include <fmt/ranges.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

// A TOML basic string.
std::string toml_string(std::string_view text) {
  std::string out = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\')
      out += fmt::format("\\{}", c);
    else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      out += fmt::format("\\u{:04X}", static_cast<unsigned>(static_cast<unsigned char>(c)));
    else
      out += c;
  }
  return out + '"';
}

std::string sensor_text(const SensorDescription& sensor) {
  std::string out = "[sensor]\n";
  if (!sensor.name.empty()) out += fmt::format("name = {}\n", toml_string(sensor.name));
  const bool custom = sensor.layout && sensor.layout->name() == "custom";
  if (sensor.layout && !custom)
    out += fmt::format("layout = {}\n", toml_string(sensor.layout->name()));
  if (sensor.black_dn.size() == 1)
    out += fmt::format("black = {}\n", sensor.black_dn[0]);
  else if (!sensor.black_dn.empty())
    out += fmt::format("black = [{}]\n", fmt::join(sensor.black_dn, ", "));
  if (sensor.white_dn) out += fmt::format("white = {}\n", *sensor.white_dn);
  if (sensor.row_group) out += fmt::format("row_group = {}\n", *sensor.row_group);
  if (sensor.raw_format)
    out += fmt::format("raw_format = {}\n", toml_string(raw_format_name(*sensor.raw_format)));
  if (sensor.rows > 0) out += fmt::format("size = \"{}x{}\"\n", sensor.cols, sensor.rows);
  if (custom) {
    out += "[sensor.cell]\nrows = [";
    for (int channel = 0; channel < sensor.layout->channels(); ++channel) {
      const int col = channel % sensor.layout->cols();
      out += fmt::format("{}{}{}", col == 0 ? "[" : ", ",
                         toml_string(sensor.layout->channel_name(channel)),
                         col + 1 == sensor.layout->cols() ? "], " : "");
    }
    out += "]\n";
  }
  return out;
}

std::string portable_path(const fs::path& file, const fs::path& folder) {
  std::error_code error;
  const fs::path relative = fs::relative(file, folder, error);
  const bool below = !error && !relative.empty() && *relative.begin() != "..";
  return (below ? relative : fs::absolute(file)).string();
}

}  // namespace

void save_session(const fs::path& path, const Session& session, bool force) {
  const fs::path folder = path.parent_path().empty() ? fs::path(".") : path.parent_path();
  if (!is_utf8(session.sensor.name))
    throw InputError(path.string(), "would hold a sensor's name that is not UTF-8, as TOML is",
                     "give another name");
  std::string out = sensor_text(session.sensor);
  for (const FrameGroup& group : session.groups) {
    out += fmt::format("\n[[frames]]\nkind = {}\n", toml_string(frame_kind_name(group.kind)));
    if (group.gain.gain_db) out += fmt::format("gain_db = {}\n", *group.gain.gain_db);
    if (group.gain.iso) out += fmt::format("iso = {}\n", *group.gain.iso);
    if (group.exposure_s) out += fmt::format("exposure_s = {}\n", *group.exposure_s);
    if (group.level) out += fmt::format("level = {}\n", *group.level);
    out += "paths = [\n";
    for (const fs::path& file : group.paths) {
      const std::string name = portable_path(file, folder);
      if (!is_utf8(name))  // other bytes would name other files
        throw InputError(path.string(), "would name files whose names are not UTF-8, as TOML is",
                         "rename the files or their folder");
      out += fmt::format("  {},\n", toml_string(name));
    }
    out += "]\n";
  }
  write_file(path, out, force);
}

}  // namespace malus
