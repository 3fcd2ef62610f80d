// The part of the model file that its kinds of noise share, and the kinds with little else
// (model_file.cpp, docs/model-file.md); the same functions write and read. In the templates Gain,
// Drift and Calibration are const when writing.
#pragma once

#include "malus/noise/calibration.h"
#include "malus/noise/internal/hdf5_archive.h"

#include <utility>
#include <vector>

namespace malus::internal {

template <class Archive, class Gain>
void transfer_gain(Archive& archive, Gain& gain) {
  const Field db{"gain_db", "dB", "gain setting of the camera"};
  const Field iso{"iso", "ISO", "gain setting of the camera"};
  for (auto [field, value] : {std::pair(&db, &gain.gain_db), std::pair(&iso, &gain.iso)}) {
    if constexpr (Archive::kReading) {
      if (archive.holds(field->name)) archive.number(*field, value->emplace());
    } else {
      if (*value) archive.number(*field, **value);
    }
  }
}

// One group; absent where the rows are white.
template <class Archive, class Drift>
void transfer_drift(Archive& parent, Drift& d) {
  if constexpr (Archive::kReading) {
    if (!parent.holds("row_drift")) return;
  } else {
    if (d.drift.white()) return;
  }
  auto archive = parent.group("row_drift");
  archive.number({"share", "1", "slow part of sigma_row squared"}, d.drift.share);
  archive.number({"share_stderr", "1", "standard error of share"}, d.share_stderr);
  archive.number({"length_groups", "row groups", "over which the slow part falls to 1/e"},
                 d.drift.length_groups);
  archive.number({"length_stderr", "row groups", "standard error of length_groups"},
                 d.length_stderr);
}

/// Absent in files from before 2026-11-29, whose level of signal zero is even inside each code.
inline Field dark_before_rounding() {
  return {"dark_before_rounding", "1", "1: level 0 is the noise before it is rounded"};
}

template <class Archive, class Calibration>
void transfer_gaussian(Archive& archive, Calibration& g) {
  transfer_gain(archive, g.gain);
  archive.integer({"levels", "1", "signal levels fitted; 0 = published"}, g.levels);
  archive.numbers({"slope_dn", "DN", "variance per signal"}, g.slope_dn);
  archive.numbers({"slope_stderr_dn", "DN", "standard error of slope_dn"}, g.slope_stderr_dn);
  archive.numbers({"offset_dn2", "DN^2", "variance at signal 0"}, g.offset_dn2);
  archive.numbers({"offset_stderr_dn2", "DN^2", "standard error of offset_dn2"},
                  g.offset_stderr_dn2);
  archive.numbers({"bias_dn", "DN", "mean of dark pixels above the black level"}, g.bias_dn);
  archive.texts({"warnings", "", "what the calibration warned about"}, g.warnings);
}

template <class Archive, class Calibration>
void transfer_nonparametric(Archive& archive, Calibration& n) {
  transfer_gain(archive, n.gain);
  archive.integer({"frames", "1", "number of frames"}, n.frames);
  archive.list("channels", n.channels, [](auto& child, auto& channel) {
    child.numbers({"level_dn", "DN", "centres of the signal levels, above black"},
                  channel.level_dn);
    child.integers({"samples", "1", "samples per level"}, channel.samples);
    child.numbers({"bin_edges_dn", "DN", "edges of the bins of noisy - clean"},
                  channel.bin_edges_dn);
    child.table({"pmf", "1", "probability per level and bin; rows add to 1"}, channel.pmf);
  });
  archive.numbers({"sigma_row_dn", "DN", "sd of the row groups' offsets"}, n.sigma_row_dn);
  archive.numbers({"sigma_row_stderr_dn", "DN", "standard error of sigma_row_dn"},
                  n.sigma_row_stderr_dn);
  transfer_drift(archive, n.row_drift);
  archive.numbers({"K", "DN/e-", "overall system gain"}, n.K);
  if constexpr (!Archive::kReading) archive.integer(dark_before_rounding(), 1);
  archive.texts({"warnings", "", "what the calibration warned about"}, n.warnings);
}

}  // namespace malus::internal
