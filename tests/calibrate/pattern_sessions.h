// Sessions of bias frames whose pattern is known.
#pragma once

#include "malus/base/random.h"
#include "malus/base/statistics.h"
#include "malus/calibrate/calibrate.h"

#include <cmath>
#include <vector>

#include "simulated_session.h"
#include <gtest/gtest.h>

namespace malus::testing {

/// Bias frames of one channel, 48x48.
inline SimulatedCamera pattern_camera(double dsnu_dn, double row_dn, int frames,
                                      std::uint64_t seed) {
  SimulatedCamera camera;
  camera.rows = camera.cols = 48;
  camera.dsnu_dn = dsnu_dn;
  camera.bias_frames = frames;
  camera.flat_levels = 0;
  camera.seed = seed;
  camera.gains.push_back(polar_gain(0, "mono", 1));
  camera.gains[0].noise.channels[0] = {
      .gain_dn_per_e = 0.5, .lambda = 0.14, .sigma_tl_dn = 1.2, .sigma_row_dn = row_dn};
  return camera;
}

/// The same with columns that are as far off in every frame.
inline PhysicsCalibration with_fixed_columns(SimulatedCamera camera, double column_dn) {
  camera.rounded = false;
  CalibrationInput input = simulated_session(camera);
  RandomSequence random(camera.seed, 77, Draw::kOther);
  std::vector<double> offset(static_cast<std::size_t>(camera.cols));
  for (double& o : offset) o = column_dn * random.normal();
  change_frames(input, [offset](RawFrame& frame, int) {
    for (int r = 0; r < frame.dn.rows(); ++r)
      for (int c = 0; c < frame.dn.cols(); ++c)
        frame.dn(r, c) =
            static_cast<float>(std::round(frame.dn(r, c) + offset[static_cast<std::size_t>(c)]));
  });
  return calibrate_physics(input, {}, silent_progress()).physics.at(0);
}

/// Over this many sessions of each kind, the squared error of DSNU and mu over the stated one has a
/// mean in this range. Rows of 3 DN, of which there are 48, make 2.5 DN from two frames uncertain
/// to 0.25 DN; without them it is 0.05. Without its columns, mu of the last would be stated a
/// seventh, DSNU a sixth as uncertain as it is.
inline void expect_stated_errors_of_patterns(int sessions, double least, double most) {
  struct Case {
    double dsnu_dn, row_dn;
    int frames;
    double column_dn = 0;
  };
  for (const auto& [dsnu_dn, row_dn, frames, column_dn] :
       {Case{0.5, 0.0, 20}, Case{1.5, 0.3, 2}, Case{2.5, 3.0, 2}, Case{0.5, 3.0, 10},
        Case{0.4, 0.3, 10, 1.5}}) {
    Moments dsnu, mu;
    for (int i = 0; i < sessions; ++i) {
      const PhysicsCalibration p = with_fixed_columns(
          pattern_camera(dsnu_dn, row_dn, frames, static_cast<unsigned>(i)), column_dn);
      const double truth_dn = std::hypot(dsnu_dn, column_dn);
      dsnu.add(std::pow((p.dsnu_dn.at(0) - truth_dn) / p.dsnu_stderr_dn.at(0), 2));
      mu.add(std::pow(p.mu.mean.at(0) / p.mu.standard_error.at(0), 2));
    }
    for (const Moments& squares : {dsnu, mu}) {
      EXPECT_GT(squares.mean(), least) << dsnu_dn << " DN, rows " << row_dn << " DN, " << frames;
      EXPECT_LT(squares.mean(), most) << dsnu_dn << " DN, rows " << row_dn << " DN, " << frames;
    }
  }
}

}  // namespace malus::testing
