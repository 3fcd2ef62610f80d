#include "malus/calibrate/frame_set.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/io/frame_file.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <future>

#include <fmt/format.h>

namespace malus {
namespace {

std::string set_name(const FrameSet& set) {
  std::string name = fmt::format("{}, {}", frame_kind_name(set.kind), set.gain.text());
  if (set.exposure_s) name += fmt::format(", {:g} s", *set.exposure_s);
  if (set.level) name += fmt::format(", level {}", *set.level);
  return name;
}

void check_frame(const RawFrame& frame, const RawFrame* like) {
  if (like && (frame.dn.rows() != like->dn.rows() || frame.dn.cols() != like->dn.cols()))
    throw InputError(frame.source,
                     fmt::format("is {}x{} pixels, but {} is {}x{}", frame.dn.cols(),
                                 frame.dn.rows(), like->source, like->dn.cols(), like->dn.rows()),
                     "all frames of a session must have one size");
  if (like && !(frame.layout == like->layout))
    throw InputError(frame.source,
                     fmt::format("has the layout {}, but {} has {}", frame.layout.name(),
                                 like->source, like->layout.name()),
                     "give the layout in the session's [sensor] section");
  for (float value : frame.dn.values())
    if (!std::isfinite(value))
      throw InputError(frame.source, "has NaN or infinite pixels", "remove this frame");
}

}  // namespace

CalibrationInput calibration_input(const Session& declared) {
  const Session session = with_settings_of_files(declared);
  CalibrationInput input;
  input.sensor = session.sensor.name;
  input.origin = "session " + session.source.filename().string();
  input.row_group = session.sensor.row_group;
  std::vector<FrameGroup> files;  // of each set
  for (const FrameGroup& group : session.groups) {
    const auto same = std::find_if(input.sets.begin(), input.sets.end(), [&](const FrameSet& set) {
      return set.kind == group.kind && set.gain == group.gain &&
             set.exposure_s == group.exposure_s && set.level == group.level;
    });
    const auto index = static_cast<std::size_t>(same - input.sets.begin());
    if (same == input.sets.end()) {
      FrameSet set;
      set.kind = group.kind;
      set.gain = group.gain;
      set.exposure_s = group.exposure_s;
      set.level = group.level;
      set.name = set_name(set);
      input.sets.push_back(std::move(set));
      files.push_back(group);
    } else {
      files[index].paths.insert(files[index].paths.end(), group.paths.begin(), group.paths.end());
    }
  }
  const Session sensor{.sensor = session.sensor, .groups = {}, .source = session.source};
  for (std::size_t i = 0; i < files.size(); ++i) {
    input.sets[i].count = static_cast<int>(files[i].paths.size());
    input.sets[i].load = [sensor, group = std::move(files[i])](int frame) {
      return load_session_frame(sensor, group, group.paths[static_cast<std::size_t>(frame)]);
    };
  }
  return input;
}

const FrameSet* bias_set_at(const GainSetting& gain, const CalibrationInput& input) {
  const FrameSet* largest = nullptr;
  for (const FrameSet& set : input.sets)
    if (set.kind == FrameKind::kBias && set.gain == gain &&
        (!largest || set.count > largest->count))
      largest = &set;
  return largest;
}

RawFrame load_first(const FrameSet& set) {
  constexpr int kFewestCells = 4;
  RawFrame first = set.load(0);
  if (first.dn.rows() < kFewestCells * first.layout.rows() ||
      first.dn.cols() < kFewestCells * first.layout.cols())
    throw InputError(
        first.source,
        fmt::format("is {}x{} pixels, less than {} cells of the layout {}", first.dn.cols(),
                    first.dn.rows(), kFewestCells, first.layout.name()),
        "calibrate with larger frames");
  return first;
}

void for_each_frame(const FrameSet& set, const RawFrame* like, Progress& progress,
                    const std::function<void(const RawFrame&, int)>& use) {
  const auto decode = [&set, like](int i) {
    RawFrame frame = set.load(i);
    check_frame(frame, like);
    return frame;
  };
  // More than a few frames in flight only cost memory: decoding is what takes the time.
  const int ahead = std::clamp(thread_count(), 1, 4);
  std::deque<std::future<RawFrame>> pending;
  int next = 0;
  for (int i = 0; i < set.count; ++i) {
    while (next < set.count && static_cast<int>(pending.size()) < ahead)
      pending.push_back(std::async(std::launch::async, decode, next++));
    const RawFrame frame = pending.front().get();
    pending.pop_front();
    check_stop(progress);
    use(frame, i);
    progress.advance(1);
  }
}

}  // namespace malus
