// malus evaluate: how near pictures, polarization and noise are to a reference.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/evaluate/evaluation.h"
#include "malus/image/finite_pixels.h"
#include "malus/image/pack.h"
#include "malus/io/frame_stack.h"
#include "malus/io/picture_file.h"
#include "malus/synthesize/synthesizer.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <vector>

#include "evaluate_noise.h"
#include "flags.h"
#include "frame_input.h"
#include "output_check.h"
#include "program.h"
#include "raw_options.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct EvaluateArguments {
  RawOptions raw;
  NoiseArguments noise;
  fs::path report;
  bool noise_mode = false;
  std::optional<double> peak_dn;
  double ratio = 1;  ///< low-light ratio: a test is multiplied by it first
};

// A mosaic, or a picture of several channels (alpha among them, which is left out); exactly one of
// them.
struct Subject {
  RawFrame frame;
  std::optional<Picture> picture;
  int rows() const { return picture ? picture->planes.rows() : frame.dn.rows(); }
  int cols() const { return picture ? picture->planes.cols() : frame.dn.cols(); }
  int channels() const { return picture ? picture->planes.channels() : 1; }
};

void leave_out_alpha(const fs::path& path, Picture& picture) {
  const auto alpha = alpha_plane(path, picture);
  if (!alpha) return;
  std::vector<Image> kept(std::make_move_iterator(picture.planes.begin()),
                          std::make_move_iterator(picture.planes.end()));
  kept.erase(kept.begin() + static_cast<std::ptrdiff_t>(*alpha));
  picture.names.erase(picture.names.begin() + static_cast<std::ptrdiff_t>(*alpha));
  picture.planes = Planes(static_cast<int>(kept.size()), 0, 0);
  std::ranges::move(kept, picture.planes.begin());
}

// Frames of a camera where that is said, and where no picture is like it: of more planes than any
// sensor has channels, or of more whole numbers than colours and alpha (those of packed planes are
// floats).
bool is_stack(const fs::path& path, bool said, const FrameOptions& options) {
  constexpr int kColorsAndAlpha = 4;
  if (options.raw_format || frame_place(path).index) return false;
  if (said) return count_frames(path) > 1;
  int frames = 1;
  try {
    frames = count_frames(path);
  } catch (const InputError&) {
    return false;  // no stack; what it is, and whether it is whole, its reader knows
  }
  return frames > SensorLayout::kMostChannels ||
         (frames > kColorsAndAlpha && probe_frame(frame_name(path, 0), options).frame.bits > 0);
}

Subject load_subject(const fs::path& path, const RawOptions& raw, const FrameOptions& options) {
  // What is a stack of frames is read by their reader, which wants one of them named.
  const bool as_frame = options.layout || raw.float_black() == FloatBlack::kHolds;
  const bool stack = is_stack(path, as_frame, options);
  if (!options.raw_format && has_picture_ending(path) && !stack) {
    Picture picture = load_picture(path);
    if (picture.planes.channels() > 1) {
      leave_out_alpha(path, picture);
      if (raw.float_black() == FloatBlack::kHolds)
        throw CLI::ValidationError(
            "--black", path.string() + " is a picture of several channels, which has none");
      return {{}, std::move(picture)};
    }
  }
  Subject subject{load_above_black(path, options), std::nullopt};
  warn_of_unknown_black(subject.frame);
  return subject;
}

// One flag serves raw frames and results, so floats that tell no black level are above it. Where
// that is not true of one of a pair, it shows.
void check_black_of_floats(const fs::path& path, const Subject& subject, const Subject& other,
                           double black_dn) {
  if (subject.picture || other.picture || subject.frame.holds_codes() || !other.frame.holds_codes())
    return;
  warn_of_held_black(path, finite_mean(subject.frame.dn.view()), finite_mean(other.frame.dn.view()),
                     black_dn, "subtract it first");
}

// The grey of a picture without alpha is loaded as a mosaic.
Planes planes_of(const Subject& subject) {
  if (subject.picture) return subject.picture->planes;
  Planes grey(1, 0, 0);
  grey[0] = subject.frame.dn;
  return grey;
}

void multiply(Subject& subject, double ratio) {
  const auto scale = [&](Image& image) {
    for (float& v : image.values()) v = static_cast<float>(v * ratio);
  };
  scale(subject.frame.dn);
  if (subject.picture)
    for (Image& plane : subject.picture->planes) scale(plane);
}

// Floats of a picture that is displayed are of 0 to 1 and hardly overshoot; light in DN may be
// stored as floats as well, and nothing in the file tells them apart.
double peak_of_picture(const fs::path& path, const Picture& picture) {
  constexpr double kMostDisplayed = 2;
  double largest = 0;
  for (const Image& plane : picture.planes)
    largest = std::max(largest, finite_largest(plane.view()));
  if (picture.bits > 0 || largest <= kMostDisplayed) return picture.white;
  warn(
      fmt::format("{}: reaches far beyond 1 and its white is not known; its largest value, {:g}, "
                  "is taken as the peak (--peak or --white)",
                  path.string(), largest));
  return largest;
}

// White above black: --peak, else what the reference knows, else what the test does (which is said:
// tests that know different whites are judged by different peaks), else the reference's container.
double peak_of(const EvaluateArguments& arguments, const fs::path& test_path,
               const Subject& reference, const Subject& test, const Common& common) {
  const fs::path& path = arguments.noise.reference.front();
  if (arguments.peak_dn) return *arguments.peak_dn;
  if (reference.picture) {
    if (const auto white_dn = arguments.raw.white_dn()) return *white_dn;
    return peak_of_picture(path, *reference.picture);
  }
  const auto knows = [](const RawFrame& frame) { return frame.white_known && frame.white_dn > 0; };
  if (knows(reference.frame)) return reference.frame.white_dn;
  if (knows(test.frame)) {
    note(common, fmt::format("{}: {:g} DN above black, its own white, is taken as the peak: {} "
                             "tells none (--peak or --white)",
                             test_path.string(), test.frame.white_dn, path.string()));
    return test.frame.white_dn;
  }
  const bool integer = reference.frame.bits > 0;
  const double assumed =
      integer ? reference.frame.white_dn : finite_largest(reference.frame.dn.view());
  if (!(assumed > 0))
    throw InputError(path.string(), "its peak is not known and it has no pixel above black",
                     "give --peak or --white");
  warn(fmt::format(
      "{}: white not known; {} {:g} DN above black is taken as the peak (--peak or "
      "--white)",
      path.string(), integer ? "the file type's largest value," : "its largest pixel,", assumed));
  return assumed;
}

void check_comparable(const fs::path& reference_path, const Subject& reference,
                      const fs::path& test_path, const Subject& test) {
  if (reference.rows() != test.rows() || reference.cols() != test.cols() ||
      reference.channels() != test.channels())
    throw InputError(
        test_path.string(),
        fmt::format("{} x {} pixels, {} against {} x {}, {} of {}", test.cols(), test.rows(),
                    counted(test.channels(), "channel"), reference.cols(), reference.rows(),
                    counted(reference.channels(), "channel"), reference_path.string()),
        "compare pictures of one size and kind");
  if (reference.frame.layout_known && test.frame.layout_known &&
      !(reference.frame.layout == test.frame.layout))
    throw InputError(test_path.string(),
                     fmt::format("has the layout {}, the reference {}", test.frame.layout.name(),
                                 reference.frame.layout.name()),
                     "compare frames of one sensor, or declare the layout with --layout");
}

int bits_of(const Subject& subject) {
  return subject.picture ? subject.picture->bits : subject.frame.bits;
}

std::string sample_text(const Subject& subject) {
  return bits_of(subject) > 0 ? fmt::format("{} bits", bits_of(subject)) : "floating point";
}

// Numbers of two scales have no difference. A peak that is told tells that they are of one. Mosaics
// are in DN whatever they are stored in.
void require_one_scale(const EvaluateArguments& arguments, const fs::path& reference_path,
                       const Subject& reference, const fs::path& test_path, const Subject& test) {
  const bool mosaics = !reference.picture && !test.picture;
  if (mosaics || arguments.peak_dn || arguments.raw.white_dn() ||
      bits_of(reference) == bits_of(test))
    return;
  throw InputError(
      test_path.string(),
      fmt::format("is of {}, its reference {} of {}", sample_text(test), reference_path.string(),
                  sample_text(reference)),
      "save both in one type, or give --peak if their numbers are of one scale (--ratio "
      "brings the test's to it)");
}

Evaluation evaluate(const fs::path& reference_path, const Subject& reference, const Subject& test,
                    double peak_dn) {
  if (reference.picture || test.picture)
    return evaluate_planes(planes_of(reference), planes_of(test), peak_dn);
  const SensorLayout& layout =
      reference.frame.layout_known ? reference.frame.layout : test.frame.layout;
  require_whole_cell(reference.frame.dn, layout, reference_path.string());
  return evaluate_mosaics(reference.frame.dn, test.frame.dn, layout, peak_dn);
}

// JSON has no infinity: null where the pictures are equal, as where nothing can be decided.
Json number(const Estimate<double>& value) {
  return value && std::isfinite(*value) ? Json(*value) : Json();
}

Json with_psnr(const Estimate<double>& psnr_db, Json others = Json::object()) {
  Json json{{"psnr", number(psnr_db)}};
  json.update(others);
  if (psnr_db && std::isinf(*psnr_db)) json["equal"] = true;
  return json;
}

Json evaluation_json(const Evaluation& e, double peak_dn) {
  Json json;
  json["peak_dn"] = peak_dn;
  json["image"] = with_psnr(e.image_psnr_db, {{"ssim", number(e.image_ssim)}});
  json["dolp"] = with_psnr(e.dolp_psnr_db);
  json["aolp"] = with_psnr(e.aolp_psnr_db, {{"circular_deg", number(e.aolp_circular_deg)}});
  return json;
}

std::string estimate_cell(const Estimate<double>& value, int decimals) {
  return value ? fmt::format("{:.{}f}", *value, decimals) : "-";
}

std::string table_line(const std::string& name, std::size_t width,
                       const std::array<std::string, 5>& cells) {
  return fmt::format("  {:<{}}{:>10}{:>9}{:>10}{:>10}{:>10}\n", name, width, cells[0], cells[1],
                     cells[2], cells[3], cells[4]);
}

std::array<std::string, 5> cells_of(const Evaluation& e) {
  return {estimate_cell(e.image_psnr_db, 2), estimate_cell(e.image_ssim, 4),
          estimate_cell(e.dolp_psnr_db, 2), estimate_cell(e.aolp_psnr_db, 2),
          estimate_cell(e.aolp_circular_deg, 2)};
}

void run_image_comparison(const EvaluateArguments& arguments, const Common& common) {
  std::vector<fs::path> read = arguments.raw.files_read();
  read.insert(read.end(), arguments.noise.test.begin(), arguments.noise.test.end());
  read.push_back(arguments.noise.reference.front());
  check_output_apart("--report", arguments.report, read, {}, common.force);
  const FrameOptions options = arguments.raw.resolve();
  const fs::path& reference_path = arguments.noise.reference.front();
  const Subject reference = load_subject(reference_path, arguments.raw, options);
  Json results = Json::array();
  std::size_t width = 32;
  for (const fs::path& path : arguments.noise.test)
    width = std::max(width, path.string().size() + 1);
  std::string text = table_line("", width, {"image dB", "SSIM", "DoLP dB", "AoLP dB", "AoLP deg"});
  for (const fs::path& path : arguments.noise.test) {
    Subject test = load_subject(path, arguments.raw, options);
    if (arguments.ratio != 1) multiply(test, arguments.ratio);
    check_comparable(reference_path, reference, path, test);
    require_one_scale(arguments, reference_path, reference, path, test);
    if (!options.black_dn.empty()) {
      const double black_dn = mean_of(options.black_dn);
      check_black_of_floats(reference_path, reference, test, black_dn);
      check_black_of_floats(path, test, reference, arguments.ratio * black_dn);
    }
    const double peak_dn = peak_of(arguments, path, reference, test, common);
    const Evaluation e = evaluate(reference_path, reference, test, peak_dn);
    if (e.pixels_left_out > 0)
      warn(fmt::format("{}: {} not finite in it or the reference and left out", path.string(),
                       counted_are(e.pixels_left_out, "pixel")));
    if (!e.dolp_psnr_db && !reference.picture && !test.picture)
      note(common, fmt::format("{}: no DoLP, no AoLP: {}", path.string(), e.dolp_psnr_db.reason()));
    if (!e.image_ssim)
      note(common, fmt::format("{}: no SSIM: {}", path.string(), e.image_ssim.reason()));
    Json json = evaluation_json(e, peak_dn);
    json["test"] = path.string();
    results.push_back(std::move(json));
    text += table_line(path.string(), width, cells_of(e));
  }
  Json json = results.size() == 1 ? results[0] : Json{{"results", results}};
  json["reference"] = reference_path.string();
  json["warnings"] = take_warnings();
  if (!arguments.report.empty()) write_evaluation_report(json, arguments.report, common.force);
  print_result(common, json, text);
}

void run_evaluate(const EvaluateArguments& arguments, const Common& common) {
  const NoiseArguments& noise = arguments.noise;
  if (noise.test.empty() == noise.model.empty())
    throw CLI::ValidationError("--test", "give either --test or, with --noise, --model");
  if (arguments.noise_mode) return run_noise_comparison(noise, arguments.raw, common);
  if (noise.reference.size() != 1)
    throw CLI::ValidationError("--reference", "one picture, unless --noise compares sets");
  run_image_comparison(arguments, common);
}

// Those of the comparison of pictures alone.
void add_picture_flags(CLI::App& command, EvaluateArguments& arguments, CLI::Option* noise) {
  command.add_option("--peak", arguments.peak_dn, "white above black for PSNR and SSIM [DN]")
      ->check(positive_number())
      ->excludes(noise);
  command
      .add_option("--ratio", arguments.ratio,
                  "low-light ratio of the tests: they are multiplied by it before the comparison")
      ->check(positive_number())
      ->capture_default_str()
      ->excludes(noise);
  command.add_option("--report", arguments.report, "also a report page (HTML)")->excludes(noise);
}

}  // namespace

void add_evaluate(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<EvaluateArguments>();
  CLI::App* command = add_command(
      app, common, "evaluate", "PSNR, SSIM, DoLP and AoLP errors; with --noise, KLD and JSD",
      {.seed = true, .force = true}, [arguments, &common] { run_evaluate(*arguments, common); });
  NoiseArguments& noise = arguments->noise;
  command->add_option("--reference", noise.reference, "the truth; with --noise a set of frames")
      ->required();
  command->add_option("--test", noise.test, "one or more to judge; with --noise a set of frames");
  const std::string group = "Noise";
  auto* mode =
      command->add_flag("--noise", arguments->noise_mode, "compare the noise of two sets of frames")
          ->group(group);
  add_picture_flags(*command, *arguments, mode);
  const std::vector<CLI::Option*> before = command->get_options();
  command->add_option("--clean", noise.clean, "the scene without noise; left out: a uniform scene");
  auto* model = command->add_option(
      "--model", noise.model,
      "noise model in place of --test: a file, a built-in name, or a trained Noise Flow "
      "(.safetensors)");
  command->add_option("--kind", noise.kind, "kind of the model's noise [physics]")
      ->check(one_of(choices_of<SynthesisSettings>("kind")))
      ->needs(model);
  command->add_option("--frames", noise.frames, "frames drawn from the model; 0 = as the reference")
      ->check(in_range(0, 1000000))
      ->needs(model);
  command->get_option("--seed")->needs(model);
  add_flags(*command, noise.settings);
  for (CLI::Option* option : command->get_options())
    if (std::find(before.begin(), before.end(), option) == before.end())
      option->needs(mode)->group(group);
  arguments->raw.add_to(*command);
}

}  // namespace malus::app
