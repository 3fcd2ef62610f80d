#include "malus/capture/plan.h"

#include <set>

#include <fmt/format.h>

namespace malus {
namespace {

constexpr int kMostFrames = 1'000'000;

void read_camera(const ConfigSection& section, CapturePlan& plan) {
  section.require_known({"id", "pixel_format", "black_level", "frame_rate_hz", "settle_frames",
                         "width", "height", "features"});
  plan.camera = section.text("id").value_or("");
  plan.pixel_format = section.text("pixel_format").value_or("");
  plan.black_level = section.number("black_level");
  plan.frame_rate_hz = section.number("frame_rate_hz");
  if (plan.frame_rate_hz && *plan.frame_rate_hz <= 0)
    section.fail("frame_rate_hz", fmt::format("is {:g}", *plan.frame_rate_hz),
                 "give a positive rate");
  plan.settle_frames = section.whole_number("settle_frames", 0, 1000).value_or(plan.settle_frames);
  plan.width = section.whole_number("width", 1, 65536).value_or(0);
  plan.height = section.whole_number("height", 1, 65536).value_or(0);
  if (const auto features = section.section("features"))
    for (const auto& key : features->keys())
      plan.features.emplace_back(key, features->text(key).value_or(""));
}

void add_steps(const ConfigSection& section, int entry, std::vector<CaptureStep>& steps) {
  section.require_known({"kind", "gain_db", "exposure_s", "frames", "level", "prompt"});
  CaptureStep step;
  step.entry = entry;
  step.kind = parse_frame_kind(section);
  step.frames = section.whole_number("frames", 1, kMostFrames).value_or(0);
  if (step.frames == 0)
    section.fail("frames", "is missing", "say how many frames to take at each setting");
  const auto gains = section.numbers("gain_db"), exposures = section.numbers("exposure_s");
  if (gains.empty()) section.fail("gain_db", "is missing", "give one gain or a list");
  if (exposures.empty())
    section.fail("exposure_s", "is missing", "give one exposure time or a list");
  const auto first_level = section.whole_number("level", 0, kMostFrames);
  step.prompt = section.text("prompt").value_or("");
  for (const double gain : gains)
    for (std::size_t i = 0; i < exposures.size(); ++i) {
      if (exposures[i] <= 0)
        section.fail("exposure_s", fmt::format("holds {:g} s", exposures[i]),
                     "an exposure is positive");
      step.gain_db = gain;
      step.exposure_s = exposures[i];
      step.level = first_level;
      if (step.kind == FrameKind::kFlat) step.level = first_level.value_or(1) + static_cast<int>(i);
      steps.push_back(step);
      step.prompt.clear();
    }
}

}  // namespace

std::string CaptureStep::folder() const {
  std::string name = fmt::format("{}/g{:g}/e{:g}", frame_kind_name(kind), gain_db, exposure_s);
  if (level) name += fmt::format("_l{}", *level);
  return name;
}

CapturePlan load_capture_plan(const std::filesystem::path& path) {
  const auto file = ConfigSection::load(path, "the capture plan");
  file.require_known({"sensor", "camera", "capture"});
  CapturePlan plan;
  plan.source = path;
  if (const auto sensor = file.section("sensor")) {
    for (const char* key : {"raw_format", "size"})
      if (sensor->has(key))
        sensor->fail(key, "is for headerless files, and frames are written as TIFF",
                     "leave it out: the camera is set by pixel_format, width and height");
    plan.sensor = parse_sensor(*sensor);
    if (plan.sensor.black_dn.size() > 1 && !plan.sensor.layout)
      sensor->fail("black",
                   fmt::format("has {} values, and no layout tells whose they are",
                               plan.sensor.black_dn.size()),
                   "give one number, or the layout");
  }
  if (const auto camera = file.section("camera")) read_camera(*camera, plan);
  const auto entries = file.sections("capture");
  if (entries.empty()) file.fail("capture", "is missing", "describe what to take with [[capture]]");
  for (std::size_t i = 0; i < entries.size(); ++i)
    add_steps(entries[i], static_cast<int>(i), plan.steps);
  std::set<std::string> folders;
  for (const auto& step : plan.steps)
    if (!folders.insert(step.folder()).second)
      throw InputError(path.string(), fmt::format("asks twice for {}", step.folder()),
                       "join the two entries, or give them different levels");
  return plan;
}

}  // namespace malus
