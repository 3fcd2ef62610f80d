// The joint model's part of the model file (model_file.cpp, docs/model-file.md); the same functions
// write and read. In the templates Segment and Joint are const when writing.
#pragma once

#include "malus/noise/internal/hdf5_archive.h"
#include "malus/noise/joint_gain.h"

#include <cstdint>
#include <string>
#include <vector>

namespace malus::internal {

/// One data set per member of the laws, channels along the first axis.
struct LawColumns {
  std::vector<double> slope, intercept, slope_stderr, intercept_stderr, residual_sd, weight;
  std::vector<std::int64_t> signed_linear;
  std::vector<std::vector<double>> residual;
};

template <class Archive>
void transfer_columns(Archive& archive, const std::string& x, LawColumns& t) {
  archive.numbers({"slope", "1", "slope of log " + x + " against log K"}, t.slope);
  archive.numbers({"intercept", "1", "log " + x + " at log K = 0"}, t.intercept);
  archive.numbers({"slope_stderr", "1", "standard error of slope"}, t.slope_stderr);
  archive.numbers({"intercept_stderr", "1", "standard error of intercept"}, t.intercept_stderr);
  archive.numbers({"residual_sd", "1", "sd of log " + x + " about the line"}, t.residual_sd);
  archive.numbers({"residual_weight", "1", "share of the residuals that errors do not explain"},
                  t.weight);
  archive.integers({"signed_linear", "1", "1: " + x + " itself was fitted, not its logarithm"},
                   t.signed_linear);
  archive.table({"residual", "1", "residual per channel and knot"}, t.residual);
}

inline void transfer_laws(Hdf5Writer& parent, const std::string& name,
                          const std::vector<LogLinear>& laws) {
  LawColumns t;
  for (const LogLinear& law : laws) {
    t.slope.push_back(law.slope);
    t.intercept.push_back(law.intercept);
    t.slope_stderr.push_back(law.slope_stderr);
    t.intercept_stderr.push_back(law.intercept_stderr);
    t.residual_sd.push_back(law.residual_sd);
    t.weight.push_back(law.residual_weight);
    t.signed_linear.push_back(law.signed_linear);
    t.residual.push_back(law.residual);
  }
  Hdf5Writer archive = parent.group(name);
  transfer_columns(archive, name, t);
}

inline void transfer_laws(const Hdf5Reader& parent, const std::string& name,
                          std::vector<LogLinear>& laws) {
  const Hdf5Reader archive = parent.group(name);
  LawColumns t;
  transfer_columns(archive, name, t);
  const std::size_t n = t.slope.size();
  for (std::size_t size :
       {t.intercept.size(), t.slope_stderr.size(), t.intercept_stderr.size(), t.residual_sd.size(),
        t.weight.size(), t.signed_linear.size(), t.residual.size()})
    if (size != n) archive.fail("", "has columns of different lengths");
  for (std::size_t c = 0; c < n; ++c)
    laws.push_back({t.slope[c], t.intercept[c], t.slope_stderr[c], t.intercept_stderr[c],
                    t.residual_sd[c], t.signed_linear[c] != 0, t.residual[c], t.weight[c]});
}

/// One column per member of the knots' drifts; absent where the rows are white at all of them.
inline void transfer_drifts(Hdf5Writer& archive, const std::vector<RowDrift>& drifts) {
  std::vector<double> share, length;
  for (const RowDrift& drift : drifts) {
    share.push_back(drift.share);
    length.push_back(drift.length_groups);
  }
  archive.numbers({"row_drift_share", "1", "slow part of sigma_row squared per knot"}, share);
  archive.numbers({"row_drift_length", "row groups", "over which the slow part falls to 1/e"},
                  length);
}

inline void transfer_drifts(const Hdf5Reader& archive, std::vector<RowDrift>& drifts) {
  std::vector<double> share, length;
  archive.numbers({"row_drift_share", "", ""}, share);
  archive.numbers({"row_drift_length", "", ""}, length);
  if (share.size() != length.size()) archive.fail("row_drift_length", "does not fit its shares");
  for (std::size_t i = 0; i < share.size(); ++i) drifts.push_back({share[i], length[i]});
}

template <class Archive, class Segment>
void transfer_segment(Archive& archive, Segment& s) {
  archive.numbers({"knots_db", "dB", "gains fitted; ISO as 20 log10(iso/100)"}, s.knots_db);
  archive.numbers({"knots_log_K", "1", "log of the mean K of the channels at the knots"},
                  s.knots_log_K);
  archive.numbers({"K_ratio", "1", "K of a channel over the mean K"}, s.K_ratio);
  std::vector<LogLinear> K_of_gain;
  if constexpr (!Archive::kReading) K_of_gain = {s.K_of_gain};
  transfer_laws(archive, "K_of_gain", K_of_gain);
  if constexpr (Archive::kReading) {
    if (K_of_gain.size() != 1) archive.fail("K_of_gain", "is not one line");
    s.K_of_gain = K_of_gain[0];
  }
  transfer_laws(archive, "minus_mu", s.minus_mu);
  transfer_laws(archive, "mu_variance", s.mu_variance);
  transfer_laws(archive, "sigma_row", s.sigma_row);
  transfer_laws(archive, "sigma_row_variance", s.sigma_row_variance);
  transfer_laws(archive, "sigma_tl", s.sigma_tl);
  transfer_laws(archive, "sigma_tl_spread", s.sigma_tl_spread);
  archive.matrix({"mu_correlation", "1", "correlation of mu between channels"}, s.mu_correlation);
  archive.matrix({"sigma_row_correlation", "1", "correlation of sigma_row between channels"},
                 s.sigma_row_correlation);
  archive.table({"lambda", "1", "Tukey-lambda shape per knot and channel"}, s.lambda);
  transfer_drifts(archive, s.row_drift);
}

template <class Archive, class Joint>
void transfer_joint(Archive& archive, Joint& joint) {
  archive.list("segments", joint.segments,
               [](auto& child, auto& segment) { transfer_segment(child, segment); });
  archive.texts({"notes", "", "what the fit of the joint model found"}, joint.notes);
}

}  // namespace malus::internal
