#include "malus/io/session.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/config_section.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"
#include "malus/io/internal/glob.h"

#include <algorithm>
#include <array>
#include <map>
#include <tuple>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

constexpr const char* kSessionTitle = "the session file";

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

SensorLayout parse_cell(const ConfigSection& cell) {
  cell.require_known({"rows"});
  if (!cell.has("rows")) cell.fail("rows", "is missing", "write rows = [[\"R90\", \"R45\"], …]");
  try {
    return SensorLayout::from_sites(cell.text_rows("rows"));
  } catch (const InputError& error) {
    cell.fail("rows", error.problem(), error.remedy());
  }
}

void parse_levels(const ConfigSection& section, SensorDescription& sensor) {
  sensor.black_dn = section.numbers("black");
  sensor.white_dn = section.number("white");
  if (sensor.white_dn && *sensor.white_dn <= 0)
    section.fail("white", fmt::format("is {:g}", *sensor.white_dn), "white is a positive DN");
  if (sensor.raw_format)
    for (const double black : sensor.black_dn)
      if (black < 0)
        section.fail("black", fmt::format("is {:g} DN, codes of raw_format begin at 0", black),
                     "correct the sign");
  if (sensor.white_dn)
    for (const double black : sensor.black_dn)
      if (black >= *sensor.white_dn)
        section.fail("black",
                     fmt::format("is {:g} DN, not below white = {:g} DN", black, *sensor.white_dn),
                     "correct black or white");
  if (sensor.black_dn.size() > 1 && sensor.layout &&
      static_cast<int>(sensor.black_dn.size()) != sensor.layout->channels())
    section.fail("black",
                 fmt::format("has {} values for the {} of the layout", sensor.black_dn.size(),
                             counted(sensor.layout->channels(), "channel")),
                 "give one number, or one per channel in mosaic order");
}

// How the paths of a session are looked for.
struct FileSearch {
  fs::path folder;
  bool check_files = true;  // else paths stay as written
  bool headerless = false;
};

// The frames of stacks each by their own names.
std::vector<fs::path> find_frames(const ConfigSection& section, const FileSearch& search) {
  const fs::path& folder = search.folder;
  std::vector<fs::path> frames;
  for (const std::string& pattern : section.texts("paths")) {
    if (pattern.empty() || pattern.find('\0') != std::string::npos)
      section.fail("paths", "holds an empty name", "name files or patterns such as bias/*.tif");
    if (!search.check_files) {
      frames.emplace_back(pattern);
      continue;
    }
    const auto found = internal::expand_glob(folder, pattern);
    if (found.empty())
      section.fail("paths", fmt::format("has \"{}\", which no file matches", pattern),
                   fmt::format("patterns are relative to {}",
                               folder.empty() ? "the current folder" : folder.string()));
    for (const fs::path& file : found) {
      internal::require_file(frame_place(file).file);
      const auto own = frame_names(file, search.headerless);
      frames.insert(frames.end(), own.begin(), own.end());
    }
  }
  if (frames.empty()) section.fail("paths", "is missing", "write paths = [\"bias/*.tif\"]");
  return frames;
}

// Sets that a file cannot be part of together: calibration would take one measurement for two, and
// a frame for clean of its own noise. One reference may serve several scenes, and what pairs are
// made of may have been measured too.
bool exclude_each_other(FrameKind a, FrameKind b) {
  const auto measures = [](FrameKind kind) {
    return kind != FrameKind::kShort && kind != FrameKind::kLong;
  };
  if (a == FrameKind::kReference && b == FrameKind::kReference) return false;
  return a == b || (measures(a) && measures(b));
}

// The frames of a session so far, links followed.
class NamedFrames {
 public:
  explicit NamedFrames(bool on_disk) : on_disk_(on_disk) {}

  // A frame counted twice has no noise against itself.
  void refuse_again(const ConfigSection& section, const FrameGroup& group) {
    std::map<fs::path, fs::path> own;
    for (const fs::path& file : group.paths) {
      const fs::path real = on_disk_ ? frame_identity(file) : file.lexically_normal();
      const auto [first, is_new] = own.emplace(real, file);
      if (!is_new) fail(section, file, first->second, "");
      const auto [begin, end] = others_.equal_range(real);
      for (auto other = begin; other != end; ++other)
        if (exclude_each_other(group.kind, other->second.kind))
          fail(section, file, other->second.written,
               fmt::format(", of {} frames already", frame_kind_name(other->second.kind)));
    }
    for (const auto& [real, file] : own) others_.emplace(real, Named{group.kind, file});
  }

 private:
  struct Named {
    FrameKind kind;
    fs::path written;
  };

  [[noreturn]] static void fail(const ConfigSection& section, const fs::path& file,
                                const fs::path& before, const std::string& where) {
    const bool same = file.lexically_normal() == before.lexically_normal();
    section.fail("paths",
                 same ? fmt::format("names {}{}", file.string(), where.empty() ? " twice" : where)
                      : fmt::format("names {}, the same file as {}{}", file.string(),
                                    before.string(), where),
                 "name every file once");
  }

  bool on_disk_;
  std::multimap<fs::path, Named> others_;
};

FrameGroup parse_group(const ConfigSection& section, const FileSearch& search) {
  section.require_known({"kind", "gain_db", "iso", "exposure_s", "level", "paths"});
  FrameGroup group;
  group.kind = parse_frame_kind(section);
  group.gain.gain_db = section.number("gain_db");
  group.gain.iso = section.number("iso");
  group.exposure_s = section.number("exposure_s");
  // Bias frames may be declared with no exposure at all.
  if (const auto fault = fault_of({group.gain, group.exposure_s}, group.kind == FrameKind::kBias))
    section.fail(fault->key, fault->problem, fault->remedy);
  group.level = section.whole_number("level", 0, kLargestLevel);
  group.paths = find_frames(section, search);
  return group;
}

// With or without [[frames]].
Session session_of(const ConfigSection& file, const fs::path& source, const fs::path& folder,
                   bool check_files) {
  file.require_known({"sensor", "frames"});
  Session session;
  session.source = source;
  if (const auto sensor = file.section("sensor")) session.sensor = parse_sensor(*sensor);
  const FileSearch search{folder, check_files, session.sensor.raw_format.has_value()};
  NamedFrames named(check_files);
  for (const auto& section : file.sections("frames")) {
    session.groups.push_back(parse_group(section, search));
    named.refuse_again(section, session.groups.back());
  }
  return session;
}

Session session_with_frames(const ConfigSection& file, const fs::path& source,
                            const fs::path& folder, bool check_files) {
  Session session = session_of(file, source, folder, check_files);
  if (session.groups.empty())
    file.fail("frames", "is missing", "describe at least one set of frames with [[frames]]");
  return session;
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

SensorDescription parse_sensor(const ConfigSection& section) {
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
      section.fail("layout", fmt::format("is \"{}\", which {}", *layout, error.problem()),
                   error.remedy());
    }
  }
  if (const auto cell = section.section("cell")) sensor.layout = parse_cell(*cell);
  sensor.row_group = section.whole_number("row_group", 1, kLargestRowGroup);
  if (const auto format = section.text("raw_format")) {
    try {
      sensor.raw_format = raw_format_named(*format);
    } catch (const InputError& error) {
      section.fail("raw_format", fmt::format("is \"{}\", which {}", *format, error.problem()),
                   error.remedy());
    }
  }
  parse_levels(section, sensor);
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

FrameKind parse_frame_kind(const ConfigSection& section) {
  const auto name = section.text("kind");
  if (!name)
    section.fail("kind", "is missing", fmt::format("known: {}", joined(frame_kind_names())));
  for (const KindEntry& entry : kKinds)
    if (*name == entry.name) return entry.kind;
  section.fail(
      "kind", fmt::format("is \"{}\"", *name),
      did_you_mean(*name, frame_kind_names(), true) + "known: " + joined(frame_kind_names()));
}

Session parse_session(std::string_view toml, const fs::path& source, const fs::path& folder,
                      bool check_files) {
  return session_with_frames(ConfigSection::parse(toml, source.string(), kSessionTitle), source,
                             folder, check_files);
}

Session load_session(const fs::path& path) {
  return session_with_frames(ConfigSection::load(path, kSessionTitle), path, path.parent_path(),
                             true);
}

SensorDescription load_sensor(const fs::path& path) {
  const auto file = ConfigSection::load(path, kSessionTitle);
  return session_of(file, path, path.parent_path(), false).sensor;
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
