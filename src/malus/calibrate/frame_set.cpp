#include "malus/calibrate/frame_set.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/statistics.h"
#include "malus/image/seen_frames.h"
#include "malus/io/frame_file.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <deque>
#include <future>

#include <fmt/format.h>

namespace malus {
namespace {

void check_frame(const RawFrame& frame, const FrameFormat* like) {
  if (like && (frame.dn.rows() != like->rows || frame.dn.cols() != like->cols))
    throw InputError(frame.source,
                     fmt::format("is {}x{} pixels, but {} is {}x{}", frame.dn.cols(),
                                 frame.dn.rows(), like->source, like->cols, like->rows),
                     "all frames of a session must have one size");
  if (like && !(frame.layout == like->layout))
    throw InputError(frame.source,
                     fmt::format("has the layout {}, but {} has {}", frame.layout.name(),
                                 like->source, like->layout.name()),
                     "give the layout in the session's [sensor] section");
  const LightRange light = light_range(frame);
  for (const float dn : frame.dn.values()) {
    if (light.holds(dn)) continue;
    if (!std::isfinite(dn))
      throw InputError(frame.source, "has NaN or infinite pixels", "remove this frame");
    throw InputError(
        frame.source,
        fmt::format("has a pixel of {:g} DN, beyond {:g} times white", dn, kMostWhites),
        "remove this frame, or check white");
  }
}

bool has_other_black(const FrameFormat& like, const RawFrame& frame) {
  return frame.black_known && like.black_known && frame.layout == like.layout &&
         frame.black_dn != like.black_dn;
}

// The pixels as a camera with the black level of `like` would have written them: DN above black are
// the file's own. Saturated ones stay. Code 0 moves along: noise that is cut off there ends as far
// below black as in the file.
void take_black_of(const FrameFormat& like, RawFrame& frame) {
  if (!has_other_black(like, frame)) return;
  const std::vector<double> zero_dn = moved_zero_dn(like, frame);
  for (int r = 0; r < frame.dn.rows(); ++r)
    for (int c = 0; c < frame.dn.cols(); ++c) {
      float& pixel = frame.dn(r, c);
      if (pixel >= like.white_dn) continue;
      pixel += static_cast<float>(zero_dn[static_cast<std::size_t>(frame.layout.channel_at(r, c))]);
    }
  frame.black_dn = like.black_dn;
}

struct DecodedFrame {
  RawFrame frame;
  std::uint64_t print = 0;  // of the pixels as they were loaded
};

}  // namespace

double FrameFormat::mean_range_dn() const { return white_dn - mean_of(black_dn); }

FrameFormat format_of(const RawFrame& frame) {
  return {.layout = frame.layout,
          .rows = frame.dn.rows(),
          .cols = frame.dn.cols(),
          .black_dn = frame.black_dn,
          .white_dn = frame.white_dn,
          .black_known = frame.black_known,
          .source = frame.source};
}

std::vector<double> moved_zero_dn(const FrameFormat& like, const RawFrame& frame) {
  std::vector<double> zero_dn(frame.black_dn.size(), 0.0);
  if (!has_other_black(like, frame)) return zero_dn;
  for (std::size_t c = 0; c < zero_dn.size(); ++c)  // as pixels hold it
    zero_dn[c] = double{static_cast<float>(like.black_dn[c] - frame.black_dn[c])};
  return zero_dn;
}

std::string frame_set_name(const FrameSet& set) {
  std::string name = fmt::format("{}, {}", frame_kind_name(set.kind), set.gain.text());
  if (set.exposure_s) name += fmt::format(", {:g} s", *set.exposure_s);
  if (set.level) name += fmt::format(", level {}", *set.level);
  return name;
}

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
      set.name = frame_set_name(set);
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
  const auto is_before = [](const FrameSet& a, const FrameSet& b) {
    return a.count != b.count ? a.count > b.count
                              : a.exposure_s.value_or(0.0) < b.exposure_s.value_or(0.0);
  };
  const FrameSet* best = nullptr;
  for (const FrameSet& set : input.sets)
    if (set.kind == FrameKind::kBias && set.gain == gain && (!best || is_before(set, *best)))
      best = &set;
  return best;
}

void require_one_gain_unit(const CalibrationInput& input) {
  const FrameSet *in_db = nullptr, *in_iso = nullptr;
  for (const FrameSet& set : input.sets) {
    if (set.gain.gain_db && !in_db) in_db = &set;
    if (set.gain.iso && !in_iso) in_iso = &set;
  }
  if (in_db && in_iso)
    throw InputError(input.origin.empty() ? "session" : input.origin,
                     fmt::format("names gains in dB ({}) and in ISO ({})", in_db->gain.text(),
                                 in_iso->gain.text()),
                     "give gain_db for all frames, or iso for all");
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

void for_each_frame(const FrameSet& set, const FrameFormat* like, Progress& progress,
                    const std::function<void(const RawFrame&, int)>& use) {
  const auto decode = [&set, like](int i) {
    DecodedFrame decoded{set.load(i), 0};
    check_frame(decoded.frame, like);
    decoded.print = pixel_fingerprint(decoded.frame.dn);
    if (like) take_black_of(*like, decoded.frame);
    return decoded;
  };
  // More than a few frames in flight only cost memory: decoding is what takes the time.
  const int ahead = std::clamp(thread_count(), 1, 4);
  std::deque<std::future<DecodedFrame>> pending;
  SeenFrames seen;
  int next = 0;
  for (int i = 0; i < set.count; ++i) {
    while (next < set.count && static_cast<int>(pending.size()) < ahead)
      pending.push_back(std::async(std::launch::async, decode, next++));
    const DecodedFrame decoded = pending.front().get();
    pending.pop_front();
    check_stop(progress);
    // References may have no noise at all.
    if (set.kind != FrameKind::kReference) seen.refuse_copy(decoded.frame, decoded.print);
    use(decoded.frame, i);
    progress.advance(1);
  }
}

}  // namespace malus
