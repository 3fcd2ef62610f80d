#include "malus/io/session.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/glob.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <set>
#include <system_error>
#include <tuple>

#include <fmt/format.h>
#include <toml++/toml.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

struct KindEntry {
  FrameKind kind;
  const char* name;
};
constexpr std::array<KindEntry, 6> kKinds = {{{FrameKind::kBias, "bias"},
                                              {FrameKind::kFlat, "flat"},
                                              {FrameKind::kBurst, "burst"},
                                              {FrameKind::kReference, "reference"},
                                              {FrameKind::kShort, "short"},
                                              {FrameKind::kLong, "long"}}};

/// A table of the file with the place to name in messages.
class Section {
 public:
  Section(const toml::table& table, std::string source, std::string title)
      : table_(table), source_(std::move(source)), title_(std::move(title)) {}

  [[noreturn]] void fail(std::string_view key, std::string_view problem,
                         std::string_view remedy) const {
    const toml::node* node = table_.get(key);
    throw InputError(subject(node ? node->source() : table_.source()),
                     fmt::format("{} in {} {}", key, title_, problem), remedy);
  }

  void require_known(const std::vector<std::string>& known) const {
    for (const auto& [key, node] : table_) {
      const std::string name(key.str());
      if (std::find(known.begin(), known.end(), name) != known.end()) continue;
      throw InputError(
          subject(node.source()), fmt::format("unknown key \"{}\" in {}", name, title_),
          fmt::format("did you mean \"{}\"? known: {}", nearest_name(name, known), joined(known)));
    }
  }

  bool has(std::string_view key) const { return table_.get(key) != nullptr; }

  std::optional<std::string> text(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (!node) return std::nullopt;
    if (!node->is_string()) fail(key, "is not a text", "put it in quotes");
    return node->ref<std::string>();
  }

  std::optional<double> number(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (!node) return std::nullopt;
    return finite(key, *node);
  }

  std::optional<int> whole_number(std::string_view key, int minimum, int maximum) const {
    const toml::node* node = table_.get(key);
    if (!node) return std::nullopt;
    const auto value = node->value_exact<std::int64_t>();
    if (!value || *value < minimum || *value > maximum)
      fail(key, fmt::format("is not a whole number from {} to {}", minimum, maximum),
           "correct the value");
    return static_cast<int>(*value);
  }

  /// One number or a list of them.
  std::vector<double> numbers(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (!node) return {};
    const toml::array* list = node->as_array();
    if (!list) return {finite(key, *node)};
    std::vector<double> values;
    for (const auto& element : *list) values.push_back(finite(key, element));
    if (values.empty()) fail(key, "is an empty list", "give one number, or one per channel");
    return values;
  }

  /// One text or a list of them.
  std::vector<std::string> texts(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (!node) return {};
    if (const auto* one = node->as_string()) return {one->get()};
    std::vector<std::string> values;
    if (const toml::array* list = node->as_array())
      for (const auto& element : *list) {
        if (!element.is_string()) fail(key, "holds something else than text", "put it in quotes");
        values.push_back(element.ref<std::string>());
      }
    if (values.empty()) fail(key, "is not a text or a list of texts", "see docs: paths = [\"…\"]");
    return values;
  }

  const toml::table* table(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (node && !node->is_table()) fail(key, "is not a table", fmt::format("write [{}]", key));
    return node ? node->as_table() : nullptr;
  }

  const toml::array* list(std::string_view key) const {
    const toml::node* node = table_.get(key);
    if (node && !node->is_array()) fail(key, "is not a list", fmt::format("write [[{}]]", key));
    return node ? node->as_array() : nullptr;
  }

  const std::string& source() const { return source_; }

 private:
  std::string subject(const toml::source_region& region) const {
    return region.begin.line > 0 ? fmt::format("{}:{}", source_, region.begin.line) : source_;
  }

  double finite(std::string_view key, const toml::node& node) const {
    const auto value = node.is_number() ? node.value<double>() : std::nullopt;
    if (!value || !std::isfinite(*value)) fail(key, "is not a number", "correct the value");
    return *value;
  }

  const toml::table& table_;
  std::string source_, title_;
};

SensorLayout parse_cell(const Section& sensor, const toml::table& table) {
  const Section cell(table, sensor.source(), "[sensor.cell]");
  cell.require_known({"rows"});
  const toml::array* rows = cell.list("rows");
  if (!rows) cell.fail("rows", "is missing", "write rows = [[\"R90\", \"R45\"], …]");
  std::vector<std::vector<std::string>> sites;
  for (const auto& row : *rows) {
    sites.emplace_back();
    const toml::array* names = row.as_array();
    if (!names) cell.fail("rows", "is not a list of lists", "write rows = [[\"R90\", \"R45\"], …]");
    for (const auto& name : *names) {
      if (!name.is_string()) cell.fail("rows", "holds something else than text", "quote the sites");
      sites.back().push_back(name.ref<std::string>());
    }
  }
  try {
    return SensorLayout::from_sites(sites);
  } catch (const InputError& error) {
    cell.fail("rows", error.problem(), error.remedy());
  }
}

void parse_levels(const Section& section, SensorDescription& sensor) {
  sensor.black_dn = section.numbers("black");
  sensor.white_dn = section.number("white");
  if (sensor.white_dn && *sensor.white_dn <= 0)
    section.fail("white", fmt::format("is {:g}", *sensor.white_dn), "white is a positive DN");
  if (sensor.white_dn)
    for (const double black : sensor.black_dn)
      if (black >= *sensor.white_dn)
        section.fail("black",
                     fmt::format("is {:g} DN, not below white = {:g} DN", black, *sensor.white_dn),
                     "correct black or white");
  if (sensor.black_dn.size() > 1 && sensor.layout &&
      static_cast<int>(sensor.black_dn.size()) != sensor.layout->channels())
    section.fail("black",
                 fmt::format("has {} values for the {} channels of the layout",
                             sensor.black_dn.size(), sensor.layout->channels()),
                 "give one number, or one per channel in mosaic order");
}

SensorDescription parse_sensor(const toml::table& table, const std::string& source) {
  const Section section(table, source, "[sensor]");
  section.require_known(
      {"name", "layout", "cell", "black", "white", "row_group", "raw_format", "size"});
  SensorDescription sensor;
  sensor.name = section.text("name").value_or("");
  if (const auto layout = section.text("layout")) {
    if (section.has("cell"))
      section.fail("cell", "stands beside a layout", "keep one of layout and [sensor.cell]");
    try {
      sensor.layout = SensorLayout::named(*layout);
    } catch (const InputError& error) {
      section.fail("layout", fmt::format("is \"{}\", {}", *layout, error.problem()),
                   error.remedy());
    }
  }
  if (const toml::table* cell = section.table("cell")) sensor.layout = parse_cell(section, *cell);
  parse_levels(section, sensor);
  sensor.row_group = section.whole_number("row_group", 1, 64);
  if (const auto format = section.text("raw_format")) {
    try {
      sensor.raw_format = raw_format_named(*format);
    } catch (const InputError& error) {
      section.fail("raw_format", fmt::format("is \"{}\", {}", *format, error.problem()),
                   error.remedy());
    }
  }
  if (const auto size = section.text("size")) {
    try {
      std::tie(sensor.rows, sensor.cols) = parse_frame_size(*size);
    } catch (const InputError& error) {
      section.fail("size", fmt::format("is \"{}\"", *size), error.remedy());
    }
  }
  if (sensor.raw_format && sensor.rows == 0)
    section.fail("raw_format", "stands without a size", "add size = \"WIDTHxHEIGHT\"");
  return sensor;
}

FrameKind parse_kind(const Section& section) {
  const auto name = section.text("kind");
  if (!name)
    section.fail("kind", "is missing", fmt::format("known: {}", joined(frame_kind_names())));
  for (const KindEntry& entry : kKinds)
    if (*name == entry.name) return entry.kind;
  section.fail("kind", fmt::format("is \"{}\"", *name),
               fmt::format("did you mean \"{}\"? known: {}",
                           nearest_name(*name, frame_kind_names()), joined(frame_kind_names())));
}

std::vector<fs::path> find_files(const Section& section, const fs::path& folder, bool check_files) {
  std::vector<fs::path> files;
  for (const std::string& pattern : section.texts("paths")) {
    if (pattern.empty() || pattern.find('\0') != std::string::npos)
      section.fail("paths", "holds an empty name", "name files or patterns such as bias/*.tif");
    if (!check_files) {
      files.emplace_back(pattern);
      continue;
    }
    const auto found = internal::expand_glob(folder, pattern);
    if (found.empty())
      section.fail(
          "paths", fmt::format("has \"{}\", which no file matches", pattern),
          fmt::format("patterns are relative to {}", folder.empty() ? "." : folder.string()));
    for (const fs::path& file : found) internal::require_file(file);
    files.insert(files.end(), found.begin(), found.end());
  }
  if (files.empty()) section.fail("paths", "is missing", "write paths = [\"bias/*.tif\"]");
  // A frame counted twice has no noise against itself.
  std::set<fs::path> seen;
  for (const fs::path& file : files)
    if (!seen.insert(file.lexically_normal()).second)
      section.fail("paths", fmt::format("names {} twice", file.string()), "name every file once");
  return files;
}

FrameGroup parse_group(const Section& section, const fs::path& folder, bool check_files) {
  section.require_known({"kind", "gain_db", "iso", "exposure_s", "level", "paths"});
  FrameGroup group;
  group.kind = parse_kind(section);
  group.gain.gain_db = section.number("gain_db");
  group.gain.iso = section.number("iso");
  if (group.gain.gain_db && group.gain.iso)
    section.fail("iso", "stands beside gain_db", "keep the one that the camera uses");
  if (group.gain.iso && *group.gain.iso <= 0)
    section.fail("iso", fmt::format("is {:g}", *group.gain.iso), "ISO is positive");
  group.exposure_s = section.number("exposure_s");
  // Bias frames may be declared with no exposure at all.
  if (group.exposure_s &&
      (*group.exposure_s < 0 || (*group.exposure_s == 0 && group.kind != FrameKind::kBias)))
    section.fail("exposure_s", fmt::format("is {:g} s", *group.exposure_s),
                 "an exposure is positive");
  group.level = section.whole_number("level", 0, 1'000'000);
  group.paths = find_files(section, folder, check_files);
  return group;
}

}  // namespace

std::string_view frame_kind_name(FrameKind kind) {
  for (const KindEntry& entry : kKinds)
    if (entry.kind == kind) return entry.name;
  MALUS_REQUIRE(false);
}

std::vector<std::string> frame_kind_names() {
  std::vector<std::string> names;
  for (const KindEntry& entry : kKinds) names.emplace_back(entry.name);
  return names;
}

Session parse_session(std::string_view toml, const fs::path& source, const fs::path& folder,
                      bool check_files) {
  toml::table root;
  try {
    root = toml::parse(toml, source.string());
  } catch (const toml::parse_error& error) {
    throw InputError(fmt::format("{}:{}", source.string(), error.source().begin.line),
                     error.description(), "correct the TOML");
  }
  const Section file(root, source.string(), "the session file");
  file.require_known({"sensor", "frames"});
  Session session;
  session.source = source;
  if (const toml::table* sensor = file.table("sensor"))
    session.sensor = parse_sensor(*sensor, source.string());
  const toml::array* frames = file.list("frames");
  if (!frames || frames->empty())
    file.fail("frames", "is missing", "describe at least one set of frames with [[frames]]");
  for (std::size_t i = 0; i < frames->size(); ++i) {
    const toml::table* table = frames->get(i)->as_table();
    if (!table) file.fail("frames", "is not a list of tables", "write [[frames]]");
    session.groups.push_back(
        parse_group(Section(*table, source.string(), fmt::format("[[frames]] number {}", i + 1)),
                    folder, check_files));
  }
  return session;
}

Session load_session(const fs::path& path) {
  constexpr std::uintmax_t kMaxBytes = 64 << 20;
  if (internal::require_file(path) > kMaxBytes)
    throw InputError(path.string(), "is too large for a session file", "name the right file");
  const auto bytes = internal::read_bytes(path);
  return parse_session({reinterpret_cast<const char*>(bytes.data()), bytes.size()}, path,
                       path.parent_path());
}

FrameOptions frame_options(const Session& session, const FrameGroup& group) {
  FrameOptions options;
  options.layout = session.sensor.layout;
  options.black_dn = session.sensor.black_dn;
  options.white_dn = session.sensor.white_dn;
  options.raw_format = session.sensor.raw_format;
  options.rows = session.sensor.rows;
  options.cols = session.sensor.cols;
  options.gain = group.gain;
  options.exposure_s = group.exposure_s;
  return options;
}

}  // namespace malus
