// The model file: one description of its content serves writing and reading (docs/model-file.md).
// In the transfer functions Model is const when writing.
#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/noise/builtin_models.h"
#include "malus/noise/code_density.h"
#include "malus/noise/internal/hdf5_archive.h"
#include "malus/noise/internal/joint_file.h"
#include "malus/noise/internal/kinds_file.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <type_traits>
#include <utility>

#include <fmt/format.h>

namespace malus {
namespace {

using internal::Field;
using internal::Hdf5Reader;
using internal::Hdf5Writer;

constexpr const char* kFormat = "malus noise model";
constexpr int kVersion = 1;

template <class Archive, class Statistics>
void transfer_statistics(Archive& parent, const std::string& name, const std::string& unit,
                         const std::string& what, Statistics& s) {
  if constexpr (Archive::kReading) {
    if (!parent.holds(name)) return;
  } else {
    if (s.mean.empty()) return;
  }
  auto archive = parent.group(name);
  const std::string squared = unit == "1" ? "1" : "(" + unit + ")^2";
  archive.numbers({"mean", unit, what + ": mean over the frames, per channel"}, s.mean);
  archive.numbers({"standard_error", unit, what + ": error of the mean"}, s.standard_error);
  archive.numbers(
      {"spread", unit, what + ": standard deviation from frame to frame, sampling error removed"},
      s.spread);
  archive.matrix({"covariance", squared,
                  what + ": covariance over the frames between channels, sampling error removed"},
                 s.covariance);
  archive.table({"per_frame", unit, what + ": each frame's own, per channel"}, s.per_frame);
}

Field saturated_column() {
  return {"saturated", "1", "1 when the point lies past the maximum of the variance"};
}

Field at_white_column() {
  return {"at_white", "1", "1 when more than a thousandth of the pixels are at the white level"};
}

Field dark_variance_column() {
  return {"dark_variance_dn2", "DN^2", "temporal variance of the level's dark frames"};
}

// Columns of the photon-transfer points <-> one data set per column.
struct TransferColumns {
  std::vector<std::int64_t> channel, used, saturated, at_white;
  std::vector<double> exposure_s, mean_dn, variance_dn2, stderr_dn2, dark_variance_dn2;
  std::vector<std::string> why_not;
};

template <class Archive>
void transfer_columns(Archive& archive, TransferColumns& t) {
  archive.integers({"channel", "1", "channel of the point, in mosaic order"}, t.channel);
  archive.numbers({"exposure_s", "s", "exposure time"}, t.exposure_s);
  archive.numbers({"mean_dn", "DN", "mean signal above dark"}, t.mean_dn);
  archive.numbers({"variance_dn2", "DN^2", "temporal variance minus the dark one"}, t.variance_dn2);
  archive.numbers({"variance_stderr_dn2", "DN^2", "standard error of the variance"}, t.stderr_dn2);
  archive.integers({"used", "1", "1 when the point took part in the fit of K"}, t.used);
  archive.texts({"why_not", "", "why the point took no part; empty when it did"}, t.why_not);
}

void transfer_points(Hdf5Writer& parent, const std::vector<PhotonTransferPoint>& points) {
  if (points.empty()) return;
  TransferColumns t;
  for (const PhotonTransferPoint& p : points) {
    t.channel.push_back(p.channel);
    t.used.push_back(p.used);
    t.saturated.push_back(p.saturated);
    t.at_white.push_back(p.at_white);
    t.exposure_s.push_back(p.exposure_s);
    t.mean_dn.push_back(p.mean_dn);
    t.variance_dn2.push_back(p.variance_dn2);
    t.stderr_dn2.push_back(p.variance_stderr_dn2);
    t.dark_variance_dn2.push_back(p.dark_variance_dn2);
    t.why_not.push_back(p.why_not);
  }
  Hdf5Writer archive = parent.group("photon_transfer");
  transfer_columns(archive, t);
  archive.integers(saturated_column(), t.saturated);
  archive.integers(at_white_column(), t.at_white);
  archive.numbers(dark_variance_column(), t.dark_variance_dn2);
}

void transfer_points(const Hdf5Reader& parent, std::vector<PhotonTransferPoint>& points) {
  if (!parent.holds("photon_transfer")) return;
  TransferColumns t;
  const Hdf5Reader archive = parent.group("photon_transfer");
  transfer_columns(archive, t);
  const std::size_t n = t.channel.size();
  t.saturated.assign(n, 0);  // files of earlier versions
  t.at_white.assign(n, 0);
  t.dark_variance_dn2.assign(n, 0.0);
  if (archive.holds("saturated")) archive.integers(saturated_column(), t.saturated);
  if (archive.holds("at_white")) archive.integers(at_white_column(), t.at_white);
  if (archive.holds("dark_variance_dn2"))
    archive.numbers(dark_variance_column(), t.dark_variance_dn2);
  for (std::size_t size : {t.used.size(), t.exposure_s.size(), t.mean_dn.size(),
                           t.variance_dn2.size(), t.stderr_dn2.size(), t.why_not.size(),
                           t.saturated.size(), t.at_white.size(), t.dark_variance_dn2.size()})
    if (size != n) archive.fail("", "has columns of different lengths");
  for (std::size_t i = 0; i < n; ++i) {
    if (t.channel[i] < 0 || t.channel[i] >= SensorLayout::kMostChannels)
      archive.fail("channel", "is out of range");
    points.push_back({static_cast<int>(t.channel[i]), t.exposure_s[i], t.mean_dn[i],
                      t.variance_dn2[i], t.stderr_dn2[i], t.used[i] != 0, t.why_not[i],
                      t.saturated[i] != 0, t.at_white[i] != 0, t.dark_variance_dn2[i]});
  }
}

// Models of earlier versions, and of cameras that cut nothing off, hold none.
template <class Archive, class Undone>
void transfer_cut_off_undone(Archive& archive, Undone& undone) {
  constexpr const char* kName = "cut_off_undone";
  if constexpr (Archive::kReading) {
    if (!archive.holds(kName)) return;
  } else {
    if (!undone) return;
  }
  int value = undone;
  archive.integer({kName, "1", "1 when the dark noise is that before it was cut off at 0"}, value);
  if constexpr (Archive::kReading) undone = value != 0;
}

template <class Archive, class Calibration>
void transfer_physics(Archive& archive, Calibration& p) {
  transfer_gain(archive, p.gain);
  archive.integer({"bias_frames", "1", "number of bias frames"}, p.bias_frames);
  archive.integer({"flat_levels", "1", "number of flat-field levels"}, p.flat_levels);
  transfer_statistics(archive, "K", "DN/e-", "overall system gain", p.K);
  archive.numbers({"K_intercept_dn2", "DN^2", "of the photon-transfer line"}, p.K_intercept_dn2);
  archive.numbers({"K_intercept_stderr_dn2", "DN^2", "standard error of that intercept"},
                  p.K_intercept_stderr_dn2);
  archive.numbers(
      {"line_intercept_dn2", "DN^2", "of the line with slope K, above the dark variance"},
      p.line_intercept_dn2);
  transfer_statistics(archive, "mu", "DN", "mean of dark pixels above the black level", p.mu);
  transfer_statistics(archive, "sigma_row", "DN", "sd of the row groups' offsets", p.sigma_row);
  transfer_drift(archive, p.row_drift);
  transfer_statistics(archive, "sigma_tl", "DN", "Tukey-lambda scale of read noise", p.sigma_tl);
  transfer_statistics(archive, "lambda", "1", "Tukey-lambda shape of read noise", p.lambda);
  transfer_statistics(archive, "sigma_column", "DN", "sd of the columns' offsets", p.sigma_column);
  archive.numbers({"temporal_sd_dark_dn", "DN", "temporal sd of dark pixels, rows and all"},
                  p.temporal_sd_dark_dn);
  archive.numbers({"temporal_sd_dark_stderr_dn", "DN", "standard error of temporal_sd_dark_dn"},
                  p.temporal_sd_dark_stderr_dn);
  archive.numbers({"dark_point_dn2", "DN^2", "variance without light that lit frames hold"},
                  p.dark_point_dn2);
  archive.numbers({"dark_point_stderr_dn2", "DN^2", "standard error of dark_point_dn2"},
                  p.dark_point_stderr_dn2);
  archive.numbers({"dark_zero_share", "1", "of the dark pixels that are cut off at 0"},
                  p.dark_zero_share);
  transfer_cut_off_undone(archive, p.cut_off_undone);
  archive.numbers(
      {"dsnu_dn", "DN", "sd of the dark pattern without defects, sampling error removed"},
      p.dsnu_dn);
  archive.numbers({"dsnu_stderr_dn", "DN", "standard error of dsnu_dn"}, p.dsnu_stderr_dn);
  archive.numbers(
      {"prnu", "1", "relative sd of the response without defects, sampling error removed"}, p.prnu);
  archive.numbers({"prnu_stderr", "1", "standard error of prnu"}, p.prnu_stderr);
  archive.matrix({"row_correlation", "1", "of row-group offsets, by channels"}, p.row_correlation);
  transfer_points(archive, p.transfer);
  archive.image({"dark_shading_dn", "DN", "mosaic: mean of the bias frames minus its channel's"},
                p.dark_shading_dn);
  archive.image({"prnu_map", "1", "mosaic: relative response, mean 1 per channel"}, p.prnu_map);
  archive.numbers({"residual_cell_dn", "DN", "cell width of residual_counts"}, p.residual_cell_dn);
  archive.table(
      {"residual_counts", "1", "bias frames' |residuals| per channel and cell; last: rest"},
      p.residual_counts);
  archive.texts({"warnings", "", "what the calibration warned about"}, p.warnings);
}

void transfer_layout(Hdf5Writer& archive, const SensorLayout& layout) {
  archive.text({"layout", "", "name of the layout"}, layout.name());
  archive.integer({"cell_rows", "1", "rows of the repeating cell"}, layout.rows());
  archive.integer({"cell_cols", "1", "columns of the repeating cell"}, layout.cols());
  archive.texts({"channels", "", "channel names in mosaic order, row by row of the cell"},
                layout.channel_names());
}

void transfer_layout(const Hdf5Reader& archive, SensorLayout& layout) {
  std::string name;
  int rows = 0, cols = 0;
  std::vector<std::string> sites;
  archive.text({"layout", "", ""}, name);
  archive.integer({"cell_rows", "", ""}, rows);
  archive.integer({"cell_cols", "", ""}, cols);
  archive.texts({"channels", "", ""}, sites);
  if (std::min(rows, cols) < 1 || std::max(rows, cols) > SensorLayout::kLargestCell ||
      sites.size() != static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols))
    archive.fail("channels",
                 fmt::format("holds {} names for a cell of {} x {}", sites.size(), rows, cols));
  std::vector<std::vector<std::string>> cell(static_cast<std::size_t>(rows));
  for (std::size_t i = 0; i < sites.size(); ++i)
    cell[i / static_cast<std::size_t>(cols)].push_back(sites[i]);
  try {
    layout = SensorLayout::from_sites(cell);
  } catch (const InputError& error) {
    archive.fail("channels", "name no layout: " + error.problem());
  }
  const auto names = SensorLayout::known_names();
  if (std::find(names.begin(), names.end(), name) == names.end()) return;
  if (!(SensorLayout::named(name) == layout))
    archive.fail("layout", fmt::format("is {}, which has other channels than the cell", name));
  layout = SensorLayout::named(name);
}

template <class Archive, class Model>
void transfer_sensor(Archive& archive, Model& m) {
  archive.text({"name", "", "sensor or camera"}, m.sensor);
  transfer_layout(archive, m.layout);
  archive.numbers({"black_dn", "DN", "nominal black level per channel"}, m.black_dn);
  archive.number({"white_dn", "DN", "saturation, black level included"}, m.white_dn);
  archive.number({"quantization_dn", "DN", "step of the converter; 0 = none"}, m.quantization_dn);
  archive.integer({"row_group", "1", "mosaic rows that share one draw of row noise"}, m.row_group);
  archive.text({"row_group_origin", "", "declared or detected"}, m.row_group_origin);
  archive.text({"origin", "", "where the numbers come from"}, m.origin);
}

// Columns of the defect list, as for the photon-transfer points.
template <class Archive>
void transfer_columns(Archive& archive, std::vector<std::int64_t>& row,
                      std::vector<std::int64_t>& col, std::vector<std::string>& kind,
                      std::vector<double>& value) {
  archive.integers({"row", "1", "mosaic row"}, row);
  archive.integers({"col", "1", "mosaic column"}, col);
  archive.texts({"kind", "", "hot, dead, noisy or stuck"}, kind);
  archive.numbers({"value", "1",
                   "what condemned the pixel: hot, robust deviations from its channel's median; "
                   "dead, relative response; noisy, stuck, normal equivalent of its variance"},
                  value);
}

template <class Archive, class Defects>
void transfer_defects(Archive& parent, Defects& defects) {
  std::vector<std::int64_t> row, col;
  std::vector<std::string> kind;
  std::vector<double> value;
  if constexpr (Archive::kReading) {
    if (!parent.holds("defects")) return;
    const auto archive = parent.group("defects");
    transfer_columns(archive, row, col, kind, value);
    if (col.size() != row.size() || kind.size() != row.size() || value.size() != row.size())
      archive.fail("", "has columns of different lengths");
    for (std::size_t i = 0; i < row.size(); ++i) {
      constexpr std::int64_t kMaxSide = 1 << 20;
      if (row[i] < 0 || row[i] >= kMaxSide || col[i] < 0 || col[i] >= kMaxSide)
        archive.fail("row", "or col is out of range");
      defects.push_back({static_cast<int>(row[i]), static_cast<int>(col[i]), kind[i], value[i]});
    }
  } else {
    if (defects.empty()) return;
    for (const DefectPixel& d : defects) {
      row.push_back(d.row);
      col.push_back(d.col);
      kind.push_back(d.kind);
      value.push_back(d.value);
    }
    auto archive = parent.group("defects");
    transfer_columns(archive, row, col, kind, value);
  }
}

template <class Archive, class Model>
void transfer_model(Archive& archive, Model& m) {
  auto sensor = archive.group("sensor");
  transfer_sensor(sensor, m);
  archive.texts({"warnings", "", "what the calibration warned about"}, m.warnings);
  if (Archive::kReading || m.saturation_limit > 0)
    archive.number({"saturation_limit", "1", "flats above this share of the range were not used"},
                   m.saturation_limit);
  archive.list("physics", m.physics, [](auto& child, auto& p) { transfer_physics(child, p); });
  if constexpr (Archive::kReading) {
    if (archive.holds("joint")) m.joint.emplace();
  }
  if (m.joint) {
    auto joint = archive.group("joint");
    internal::transfer_joint(joint, *m.joint);
  }
  archive.list("gaussian", m.gaussian, [](auto& child, auto& g) { transfer_gaussian(child, g); });
  archive.list("nonparametric", m.nonparametric,
               [](auto& child, auto& n) { transfer_nonparametric(child, n); });
  archive.list("dark_frames", m.dark_frames, [](auto& child, auto& bank) {
    transfer_gain(child, bank.gain);
    child.images({"frames_dn", "DN", "bias frames as taken, black level subtracted"},
                 bank.frames_dn);
  });
  transfer_defects(archive, m.defects);
}

// Those of files without the mark.
void smooth_older_darks(const Hdf5Reader& archive, NoiseModel& model) {
  std::vector<int> is_marked;  // per calibration
  archive.list("nonparametric", is_marked, [](const Hdf5Reader& child, int& marked) {
    child.integer(internal::dark_before_rounding(), marked);
  });
  for (std::size_t i = 0; i < is_marked.size(); ++i) {
    if (is_marked[i] != 0) continue;
    std::vector<NonparametricChannel>& channels = model.nonparametric[i].channels;
    for (std::size_t c = 0; c < channels.size(); ++c)
      channels[c] =
          smooth_inside_codes(std::move(channels[c]), model.black_dn[c], model.quantization_dn);
  }
}

}  // namespace

NoiseModel load_model(const std::filesystem::path& path) {
  if (const std::optional<NoiseModel> builtin = builtin_model_for(path)) return *builtin;
  const internal::Hdf5Session session;
  const Hdf5Reader archive(path);
  const int version = archive.version();
  if (version < 1 || version > kVersion)
    throw InputError(path.string(), fmt::format("has version {} of the model file", version),
                     fmt::format("this program reads version {}: update it", kVersion));
  NoiseModel model;
  transfer_model(archive, model);
  if (const std::string problem = contradiction_in(model); !problem.empty())
    archive.fail("the model", "contradicts itself: " + problem);
  smooth_older_darks(archive, model);
  return model;
}

void save_model(const NoiseModel& model, const std::filesystem::path& path, bool force) {
  MALUS_REQUIRE(contradiction_in(model).empty());
  AtomicFile file(path, force);
  try {
    const internal::Hdf5Session session;
    Hdf5Writer archive(file.temporary());
    archive.version(kFormat, kVersion);
    transfer_model(archive, model);
    archive.close();
  } catch (const internal::Hdf5WriteError& error) {
    if (error.too_large.empty()) file.fail(fmt::format("HDF5 refused {}", error.field));
    throw InputError(
        path.string(),
        fmt::format("{} has {} values, more than a model file holds", error.field, error.too_large),
        "calibrate with fewer levels, bins or frames");
  }
  file.commit();
}

}  // namespace malus
