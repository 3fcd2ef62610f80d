#include "malus/capture/capture.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/folder_lock.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/base/unfinished_files.h"
#include "malus/capture/camera.h"
#include "malus/capture/internal/frame_writer.h"
#include "malus/capture/internal/loss_count.h"
#include "malus/io/frame_file.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <fstream>
#include <iterator>

#include <fmt/format.h>

namespace malus {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kStreamBytes = 256u << 20;
constexpr std::size_t kQueueBytes = 256u << 20;  // frames that wait for the disk
constexpr double kSaturationWarning = 0.001;
constexpr const char* kPlanCopy = "plan.toml";

// A folder belongs to one plan: its copy lies beside the frames. Contract: it is there.
void claim_folder(const CapturePlan& plan, const fs::path& folder) {
  const auto content = [](const fs::path& path) {
    std::ifstream in(path, std::ios::binary);
    return std::string{std::istreambuf_iterator<char>(in), {}};
  };
  const fs::path copy = folder / kPlanCopy;
  std::error_code absent;
  if (fs::equivalent(plan.source, copy, absent))  // a change of it could not be told
    throw InputError(plan.source.string(), "lies where its copy is kept beside the frames",
                     "move it out of that folder, or choose another one");
  if (!fs::exists(copy)) {
    write_file(copy, content(plan.source), false);
  } else if (content(copy) != content(plan.source)) {
    throw InputError(folder.string(), "holds frames of another plan",
                     "choose another folder, or remove this one");
  }
}

void check_range(const CapturePlan& plan, const char* what, double value, ValueRange range,
                 const char* unit) {
  // The camera's own steps may move its ends by a rounding.
  const double slack = 1e-9 * std::max(std::abs(range.low), std::abs(range.high));
  if (value >= range.low - slack && value <= range.high + slack) return;
  throw InputError(plan.source.string(), fmt::format("asks for {} {:g} {}", what, value, unit),
                   fmt::format("this camera has {:g} to {:g} {}", range.low, range.high, unit));
}

// What a camera reports of itself at a step's settings.
struct SettingsInForce {
  double gain_db = 0, exposure_s = 0, frame_rate_hz = 0;
};

// What a camera rounds to its own steps, lines of the sensor for short exposures, is as good; what
// it takes beyond that is another measurement than the plan's.
void require_in_force(const CapturePlan& plan, const CaptureStep& step,
                      const SettingsInForce& now) {
  constexpr double kGainStep_db = 0.1, kExposureStep = 0.02, kLine_s = 30e-6;
  if (std::abs(now.gain_db - step.gain_db) > kGainStep_db)
    throw InputError(plan.source.string(),
                     fmt::format("asks for a gain of {:g} dB, the camera takes {:g} dB",
                                 step.gain_db, now.gain_db),
                     "give a gain that it has");
  if (std::abs(now.exposure_s - step.exposure_s) <=
      std::max(kExposureStep * step.exposure_s, kLine_s))
    return;
  const bool shorter = now.exposure_s < step.exposure_s && now.frame_rate_hz > 0;
  throw InputError(
      plan.source.string(),
      fmt::format("asks for an exposure of {:g} s, the camera takes {:g} s{}", step.exposure_s,
                  now.exposure_s,
                  shorter ? fmt::format(" at {:g} frames per second", now.frame_rate_hz) : ""),
      !shorter             ? "give an exposure that it has"
      : plan.frame_rate_hz ? "lower frame_rate_hz"
                           : "give a lower frame_rate_hz");
}

// On many cameras the exposure must fit into a frame's time, and the highest rate is that at the
// exposure in force: the rate makes room first, and is set after the exposure.
SettingsInForce set_up(const CapturePlan& plan, const CaptureStep& step, Camera& camera) {
  camera.make_room_for(step.exposure_s);
  camera.set_gain_db(step.gain_db);
  camera.set_exposure_s(step.exposure_s);
  camera.set_frame_rate_hz(plan.frame_rate_hz.value_or(0));
  const SettingsInForce now{camera.gain_db(), camera.exposure_s(), camera.frame_rate_hz()};
  require_in_force(plan, step, now);
  return now;
}

// Frames of another size are another measurement: a fixed pattern fits them no more.
void require_size(const CapturePlan& plan, const Camera& camera) {
  const auto [width, height] = camera.size();
  const auto other = [](int asked, int taken) { return asked > 0 && asked != taken; };
  if (!other(plan.width, width) && !other(plan.height, height)) return;
  throw InputError(plan.source.string(),
                   fmt::format("asks for frames of {} x {} pixels, the camera takes {} x {}",
                               plan.width > 0 ? plan.width : width,
                               plan.height > 0 ? plan.height : height, width, height),
                   "give a width and a height that it has");
}

std::string prepare_camera(const CapturePlan& plan, Camera& camera) {
  camera.turn_automatics_off();
  const std::string pixel_format = camera.set_pixel_format(plan.pixel_format);
  camera.set_size(plan.width, plan.height);
  if (plan.black_level) camera.set_black_level(*plan.black_level);
  for (const auto& [name, value] : plan.features) camera.set_feature(name, value);
  require_size(plan, camera);  // features, as binning, change it
  double longest_s = 0;
  for (const auto& step : plan.steps) longest_s = std::max(longest_s, step.exposure_s);
  camera.make_room_for(longest_s);
  const ValueRange gains = camera.gain_range_db(), exposures = camera.exposure_range_s();
  for (const auto& step : plan.steps) {
    check_range(plan, "a gain of", step.gain_db, gains, "dB");
    check_range(plan, "an exposure of", step.exposure_s, exposures, "s");
  }
  for (const auto& step : plan.steps) set_up(plan, step, camera);
  return pixel_format;
}

fs::path frame_path(const fs::path& folder, int index) {
  return folder / fmt::format("f{:06d}.tif", index + 1);
}

// A machine that loses its power may leave a frame's name without its content.
bool is_whole(const fs::path& frame) try {
  const FrameInfo info = probe_frame(frame);
  const auto pixels =
      static_cast<std::uintmax_t>(info.rows) * static_cast<std::uintmax_t>(info.cols);
  return fs::file_size(frame) > sizeof(std::uint16_t) * pixels;
} catch (const InputError&) {
  return false;
}

// Frames are written in order and appear whole: the first gap is where an interrupted run stopped.
// Its writers may have left gaps: what lies beyond the first is taken again.
int whole_frames(const fs::path& folder, int wanted) {
  int count = 0;
  while (count < wanted && fs::exists(frame_path(folder, count)) &&
         is_whole(frame_path(folder, count)))
    ++count;
  return count;
}

RawFrame decoded(const CameraFrame& in, const CapturePlan& plan, const StepReport& report) {
  RawFrame frame;
  frame.dn = Image(in.rows, in.cols);
  decode_raw(in.format, in.bytes, frame.dn);
  frame.layout = plan.sensor.layout.value_or(SensorLayout());
  frame.layout_known = plan.sensor.layout.has_value();
  frame.black_known = !plan.sensor.black_dn.empty();
  frame.black_dn.assign(static_cast<std::size_t>(frame.layout.channels()), 0.0);
  for (std::size_t i = 0; i < frame.black_dn.size() && frame.black_known; ++i)
    frame.black_dn[i] = plan.sensor.black_dn[plan.sensor.black_dn.size() == 1 ? 0 : i];
  frame.white_dn = plan.sensor.white_dn.value_or(std::ldexp(1.0, in.bits) - 1);
  frame.white_known = true;
  frame.bits = in.bits;
  frame.gain.gain_db = report.gain_db;
  frame.exposure_s = report.exposure_s;
  return frame;
}

// Mean, saturation and temporal noise over the frames of a step; one frame is kept for the
// difference.
class LiveCheck {
 public:
  void add(const RawFrame& frame) {
    double sum = 0, squares = 0, difference = 0;
    std::int64_t saturated = 0;
    const auto& now = frame.dn.values();
    const bool paired = previous_.size() == now.size();
    for (std::size_t i = 0; i < now.size(); ++i) {
      sum += now[i];
      saturated += now[i] >= frame.white_dn ? 1 : 0;
      if (!paired) continue;
      const double d = double{now[i]} - previous_[i];
      difference += d;
      squares += d * d;
    }
    const auto n = static_cast<double>(now.size());
    mean_.add(sum / n);
    saturated_.add(static_cast<double>(saturated) / n);
    // Half the variance of the difference of two frames, their means removed (lamps flicker).
    if (paired) variance_.add(0.5 * (squares / n - difference / n * difference / n));
    previous_ = now;
  }
  void report(StepReport& out) const {
    if (mean_.count() == 0) return;
    out.mean_dn = mean_.mean();
    out.saturated_share = saturated_.mean();
    if (variance_.count() > 0) out.temporal_sd_dn = std::sqrt(variance_.mean());
  }

 private:
  std::vector<float> previous_;
  Moments mean_, saturated_, variance_;
};

// What was lost since the start: gaps in the camera's count, or, for cameras that count only what
// arrives, what the stream says.
std::int64_t lost_frames(const LossCount& gaps, const StreamCounts& start,
                         const StreamCounts& now) {
  const auto told = now.damaged - start.damaged + now.unreceived - start.unreceived;
  return static_cast<std::int64_t>(std::max(gaps.lost(), told));
}

void settle(Camera& camera, int frames, double timeout_s, const Progress& progress) {
  CameraFrame unused;
  for (int i = 0; i < frames; ++i) {
    check_stop(progress);
    camera.next(unused, timeout_s);
  }
}

class Run {
 public:
  Run(const CapturePlan& plan, const fs::path& folder, Camera& camera,
      const CaptureWatcher& watcher, Progress& progress)
      : plan_(plan), folder_(folder), camera_(camera), watcher_(watcher), progress_(progress) {}

  bool is_taken(const CaptureStep& step) const {
    return whole_frames(folder_ / step.folder(), step.frames) == step.frames;
  }

  StepReport take(const CaptureStep& step) {
    StepReport report;
    report.step = step;
    const fs::path folder = folder_ / step.folder();
    make_output_folder(folder);
    remove_unfinished(folder, [](std::string_view name) { return name.ends_with(".tif"); });
    report.kept = whole_frames(folder, step.frames);
    if (const fs::path next = frame_path(folder, report.kept);
        report.kept < step.frames && fs::exists(next))
      progress_.warn(fmt::format("{}: is damaged or cut off; frames from it on are taken again",
                                 next.string()));
    const SettingsInForce now = set_up(plan_, step, camera_);
    report.gain_db = now.gain_db;
    report.exposure_s = now.exposure_s;
    report.frame_rate_hz = now.frame_rate_hz;
    progress_.begin(
        fmt::format("{} {:g} dB {:g} s", frame_kind_name(step.kind), step.gain_db, step.exposure_s),
        step.frames);
    progress_.advance(report.kept);
    if (report.kept < step.frames) stream(folder, report);
    return report;
  }

 private:
  using Clock = std::chrono::steady_clock;

  void stream(const fs::path& folder, StepReport& report) {
    const double timeout_s = report.exposure_s + kPatience_s;
    camera_.start(kStreamBytes);
    settle(camera_, plan_.settle_frames, timeout_s, progress_);
    LiveCheck check;
    const StreamCounts start = camera_.counts();
    LossCount gaps;
    CameraFrame frame;
    std::optional<FrameWriter> writer;
    auto watched = Clock::now();
    while (report.kept + report.taken < report.step.frames) {
      wait_for_whole(frame, timeout_s);
      gaps.add(frame.number);
      RawFrame raw = decoded(frame, plan_, report);
      check.add(raw);
      if (!writer)
        writer.emplace(thread_count(),
                       std::max<std::size_t>(4, kQueueBytes / (raw.dn.size() * sizeof(float))));
      writer->write(frame_path(folder, report.kept + report.taken), std::move(raw));
      ++report.taken;
      progress_.advance(1);
      if (Clock::now() - watched < kWatchInterval) continue;
      watched = Clock::now();
      report.lost = lost_frames(gaps, start, camera_.counts());
      check.report(report);
      watcher_.watch(report);
    }
    report.lost = lost_frames(gaps, start, camera_.counts());
    if (writer) writer->finish();
    camera_.stop();
    check.report(report);
    watcher_.watch(report);
    warn_about(report);
  }

  void wait_for_whole(CameraFrame& frame, double timeout_s) {
    for (int damaged = 0, silent = 0;;) {
      check_stop(progress_);
      const FrameStatus status = camera_.next(frame, timeout_s);
      if (status == FrameStatus::kWhole) return;
      if (status == FrameStatus::kDamaged && ++damaged == kMostDamaged)
        throw InputError(plan_.source.string(),
                         fmt::format("no whole frame in {} tries", kMostDamaged),
                         "check the cable, the packet size and the bandwidth of the link");
      if (status == FrameStatus::kNone && ++silent == kMostSilent)
        throw InputError(plan_.source.string(),
                         fmt::format("no frame came in {:g} s", silent * timeout_s),
                         "check the cable and the camera's trigger; the same command continues");
    }
  }

  void warn_about(const StepReport& report) {
    const double saturated = report.saturated_share.value_or(0);
    if (saturated > kSaturationWarning && report.step.kind != FrameKind::kBias)
      progress_.warn(
          fmt::format("{}: {:.2f} % of the pixels are saturated; lower the light or the exposure",
                      report.step.folder(), 100 * saturated));
    if (report.lost > 0)
      progress_.warn(fmt::format("{}: {} lost on the way and taken again", report.step.folder(),
                                 counted(report.lost, "frame")));
  }

  static constexpr int kMostDamaged = 20, kMostSilent = 3;  // in a row
  static constexpr double kPatience_s = 2;                  // beyond the exposure
  static constexpr std::chrono::seconds kWatchInterval{1};
  const CapturePlan& plan_;
  fs::path folder_;
  Camera& camera_;
  const CaptureWatcher& watcher_;
  Progress& progress_;
};

fs::path write_session(const CapturePlan& plan, const fs::path& folder,
                       const CaptureReport& report) {
  Session session;
  session.sensor = plan.sensor;
  // A camera may tell its name in any bytes, which is no reason to lose what was taken.
  if (session.sensor.name.empty() && is_utf8(report.camera)) session.sensor.name = report.camera;
  for (const auto& step : report.steps) {
    FrameGroup group;
    group.kind = step.step.kind;
    group.gain.gain_db = step.gain_db;
    group.exposure_s = step.exposure_s;
    group.level = step.step.level;
    for (int i = 0; i < step.step.frames; ++i)
      group.paths.push_back(frame_path(folder / step.step.folder(), i));
    session.groups.push_back(std::move(group));
  }
  const fs::path path = folder / "session.toml";
  save_session(path, session, true);
  return path;
}

}  // namespace

CaptureReport capture(const CapturePlan& plan, const fs::path& folder,
                      const CaptureWatcher& watcher, Progress& progress) {
  Camera camera(plan.camera);
  CaptureReport report;
  report.camera = camera.name();
  report.pixel_format = prepare_camera(plan, camera);
  // After the camera's checks: a plan that it refuses can be corrected and given the same folder.
  make_output_folder(folder);
  const FolderLock lock(folder, "capture");
  claim_folder(plan, folder);
  Run run(plan, folder, camera, watcher, progress);
  const CaptureStep* first = nullptr;  // of its entry
  bool asked = false;
  for (const auto& step : plan.steps) {
    if (!first || first->entry != step.entry) {
      first = &step;
      asked = step.prompt.empty();
    }
    if (!asked && !run.is_taken(step)) {
      asked = true;
      watcher.ask(*first);
    }
    report.steps.push_back(run.take(step));
  }
  report.session = write_session(plan, folder, report);
  return report;
}

}  // namespace malus
