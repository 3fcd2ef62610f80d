// What every step of the calibration of one gain is given.
#pragma once

#include "malus/base/error.h"
#include "malus/calibrate/calibrate.h"
#include "malus/calibrate/frame_set.h"
#include "malus/calibrate/geometry.h"
#include "malus/image/view.h"

#include <functional>
#include <optional>
#include <vector>

namespace malus {

/// The sets of one gain. The bias set is the largest dark one; the others are dark partners of
/// flats with their exposure. Flats of the bias frames' own exposure have them as their dark point
/// anyway.
struct GainPlan {
  GainSetting gain;
  const FrameSet* bias = nullptr;
  std::vector<const FrameSet*> darks, flats;
};

/// Row group in force, and whether it was declared or detected: a wrong one looks like drift.
struct RowGroup {
  int rows = 1;
  bool known = false;
};

/// The sets of one gain, how their frames are read, and what the user asked for. The first pass
/// over the bias frames tells the row group; all later steps take the geometry from here.
class GainRun {
 public:
  /// Format and settings are the whole sensor's; all is referred to. first: of the plan's bias
  /// frames, as it was loaded. Contract: the plan has bias frames.
  GainRun(const GainPlan& plan, const FrameFormat& format, const RawFrame& first,
          const CalibrationSettings& settings, Progress& progress)
      : plan_(plan),
        format_(format),
        first_dn_(first.dn),
        zero_dn_(moved_zero_dn(format, first)),
        settings_(settings),
        progress_(progress) {
    MALUS_REQUIRE(plan.bias);
  }
  const GainPlan& plan() const { return plan_; }
  const FrameSet& bias() const { return *plan_.bias; }
  const FrameFormat& format() const { return format_; }
  View<const float> first_dn() const { return first_dn_; }
  /// Per channel, where frames that end at DN 0 end once they are moved to the format's black
  /// level.
  const std::vector<double>& zero_dn() const { return zero_dn_; }
  const CalibrationSettings& settings() const { return settings_; }
  Progress& progress() const { return progress_; }
  /// for_each_frame of one of the plan's sets.
  void each_frame(const FrameSet& set, const std::function<void(const RawFrame&, int)>& use) const {
    for_each_frame(set, &format_, progress_, use);
  }

  void set_row_group(RowGroup group) {
    row_group_ = group;
    geometry_ = format_.geometry(group.rows);
  }
  /// Contract, of all three: set_row_group was called.
  RowGroup row_group() const {
    MALUS_REQUIRE(geometry_);
    return row_group_;
  }
  const MosaicGeometry& geometry() const {
    MALUS_REQUIRE(geometry_);
    return *geometry_;
  }
  /// In a frame; the last one may lack rows.
  double row_groups() const { return static_cast<double>(format_.rows) / row_group().rows; }

 private:
  const GainPlan& plan_;
  const FrameFormat& format_;
  View<const float> first_dn_;
  std::vector<double> zero_dn_;
  const CalibrationSettings& settings_;
  Progress& progress_;
  RowGroup row_group_;
  std::optional<MosaicGeometry> geometry_;
};

}  // namespace malus
