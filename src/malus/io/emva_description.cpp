#include "malus/io/emva_description.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/io/internal/decoded.h"
#include "malus/io/internal/file_bytes.h"

#include <algorithm>
#include <cmath>
#include <system_error>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

class Parser {
 public:
  Parser(const fs::path& source, const fs::path& folder, bool check_files)
      : source_(source), folder_(folder), check_files_(check_files) {}

  void line(std::string_view text) {
    ++line_;
    const auto words = split(text);
    if (words.empty() || words[0].starts_with('#')) return;
    const std::string_view key = words[0];
    if (key == "v")
      version(words);
    else if (key == "n")
      sensor(words);
    else if (key == "b" || key == "d")
      set(words, key == "b");
    else if (key == "i")
      image(text);
    else
      fail(fmt::format("unknown entry \"{}\"", key), "entries are v, n, b, d and i");
  }

  EmvaSession finish() {
    auto& groups = result_.session.groups;
    if (!has_sensor_) fail("no \"n bits width height\" line", "add it");
    const auto without_any = std::stable_partition(
        groups.begin(), groups.end(), [](const FrameGroup& group) { return !group.paths.empty(); });
    if (without_any == groups.begin())
      fail("none of its images exists", "image names are relative to the description's folder");
    if (result_.missing_images > 0) tell_missing(without_any);
    groups.erase(without_any, groups.end());
    result_.session.source = source_;
    return std::move(result_);
  }

 private:
  using Words = std::vector<std::string_view>;
  using Groups = std::vector<FrameGroup>;

  // Calibration can do nothing with a session without dark frames.
  void tell_missing(Groups::iterator without_any) {
    Groups& groups = result_.session.groups;
    const auto dark = [](const FrameGroup& group) { return group.kind == FrameKind::kBias; };
    if (std::none_of(groups.begin(), without_any, dark) &&
        std::any_of(without_any, groups.end(), dark))
      throw InputError(source_.string(), "the images of its dark sets are all absent",
                       "copy them to where it names them: a calibration needs them");
    const int missing = result_.missing_images;
    std::string line =
        fmt::format("{}: {} of the {} that it names {} absent and left out{} {}", source_.string(),
                    missing, counted(images_, "image"), missing == 1 ? "is" : "are",
                    missing == 1 ? ":" : ", the first of them", first_missing_);
    if (const auto sets = std::distance(without_any, groups.end()); sets > 0)
      line += fmt::format("; {} none left and {} left out too",
                          sets == 1 ? "1 set has" : fmt::format("{} sets have", sets),
                          sets == 1 ? "is" : "are");
    result_.notes.push_back(std::move(line));
  }

  static Words split(std::string_view text) {
    constexpr std::string_view kSpace = " \t\r";
    Words words;
    while (true) {
      const auto begin = text.find_first_not_of(kSpace);
      if (begin == std::string_view::npos) return words;
      text.remove_prefix(begin);
      const auto end = std::min(text.find_first_of(kSpace), text.size());
      words.push_back(text.substr(0, end));
      text.remove_prefix(end);
    }
  }

  [[noreturn]] void fail(std::string_view problem, std::string_view remedy) const {
    throw InputError(fmt::format("{}:{}", source_.string(), line_), problem, remedy);
  }

  double number(std::string_view word, std::string_view what) const {
    const auto value = decimal_number(word);
    if (!value) fail(fmt::format("{} is \"{}\"", what, word), "it is a number");
    return *value;
  }

  void need(const Words& words, std::size_t count, std::string_view form) const {
    if (words.size() != count)
      fail(fmt::format("the entry has not the form \"{}\"", form), "correct it");
  }

  void version(const Words& words) const {
    need(words, 2, "v 3.0");
    const double value = number(words[1], "the version");
    if (value < 3.0 || value >= 5.0)
      fail(fmt::format("version {:g} is not known", value), "version 3 or 4 is read");
  }

  void sensor(const Words& words) {
    need(words, 4, "n bits width height");
    const double bits = number(words[1], "bits"), width = number(words[2], "the width"),
                 height = number(words[3], "the height");
    constexpr double kMaxExtent = 1 << 20;
    const auto whole = [](double value, double most) {
      return value >= 1 && value <= most && value == std::floor(value);
    };
    if (!(whole(bits, 24) && whole(width, kMaxExtent) && whole(height, kMaxExtent)))
      fail("bits, width or height is out of range or not a whole number", "correct it");
    auto& sensor = result_.session.sensor;
    sensor.white_dn = std::ldexp(1.0, static_cast<int>(bits)) - 1.0;
    sensor.layout = SensorLayout::named("mono");
    sensor.black_dn = {0.0};  // none is described: all of the dark signal counts as measured
    sensor.cols = static_cast<int>(width);
    sensor.rows = static_cast<int>(height);
    has_sensor_ = true;
  }

  void set(const Words& words, bool bright) {
    need(words, bright ? 3 : 2, bright ? "b exposure_ns photons" : "d exposure_ns");
    FrameGroup group;
    group.kind = bright ? FrameKind::kFlat : FrameKind::kBias;
    group.exposure_s = number(words[1], "the exposure") * 1e-9;
    if (*group.exposure_s < 0 || (bright && *group.exposure_s == 0))
      fail(fmt::format("the exposure is {} ns", words[1]), "an exposure is positive");
    if (bright) {
      number(words[2], "the number of photons");  // not used: the light is measured
      group.level = ++levels_;
    }
    result_.session.groups.push_back(std::move(group));
  }

  void image(std::string_view text) {
    if (result_.session.groups.empty()) fail("an image before the first b or d", "add its set");
    // The name is the rest of the line and may hold blanks; the sets were made on Windows.
    text.remove_prefix(std::min(text.size(), text.find('i') + 1));
    const auto begin = text.find_first_not_of(" \t");
    const auto end = text.find_last_not_of(" \t\r");
    if (begin == std::string_view::npos) fail("an image without a name", "add the name");
    std::string name(text.substr(begin, end - begin + 1));
    std::replace(name.begin(), name.end(), '\\', '/');
    const fs::path path = folder_ / name;
    std::error_code ignored;
    ++images_;
    if (!check_files_ || fs::is_regular_file(path, ignored))
      result_.session.groups.back().paths.push_back(path);
    else if (++result_.missing_images == 1)
      first_missing_ = fmt::format("{} (line {})", name, line_);
  }

  fs::path source_, folder_;
  bool check_files_;
  EmvaSession result_;
  std::string first_missing_;
  int line_ = 0, levels_ = 0, images_ = 0;
  bool has_sensor_ = false;
};

}  // namespace

EmvaSession parse_emva_description(std::string_view text, const fs::path& source,
                                   const fs::path& folder, bool check_files) {
  constexpr std::string_view kByteOrderMark = "\xef\xbb\xbf";
  if (text.starts_with(kByteOrderMark)) text.remove_prefix(kByteOrderMark.size());
  Parser parser(source, folder, check_files);
  while (!text.empty()) {
    const auto end = std::min(text.find('\n'), text.size());
    parser.line(text.substr(0, end));
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return parser.finish();
}

EmvaSession load_emva_description(const fs::path& path) {
  return parse_emva_description(internal::read_text(path, "a description"), path,
                                path.parent_path());
}

}  // namespace malus
