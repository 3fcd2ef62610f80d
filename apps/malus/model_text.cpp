// The text of `model show`.
#include "malus/base/index.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/noise/data_sheet.h"
#include "malus/noise/physics.h"

#include <algorithm>
#include <cmath>
#include <iterator>

#include "model_json.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

using Values = std::vector<double>;

// Above this many gains the tables per channel are left to --gain.
constexpr std::size_t kMaxChannelTables = 8;

class Lines {
 public:
  template <class... Arguments>
  void add(fmt::format_string<Arguments...> format, Arguments&&... arguments) {
    fmt::format_to(std::back_inserter(text_), format, std::forward<Arguments>(arguments)...);
    text_ += '\n';
  }
  const std::string& text() const { return text_; }

 private:
  std::string text_;
};

// Mean over the channels; "-" where nothing was measured.
std::string mean_cell(const Values& values, int digits) {
  if (values.empty()) return "-";
  return fmt::format("{:.{}f}", mean_of(values), digits);
}

std::string value_cell(const Values& values, std::size_t c, int digits) {
  if (c >= values.size() || !std::isfinite(values[c])) return "-";
  return fmt::format("{:.{}f}", values[c], digits);
}

// Decimals that show one digit of an error, two where it begins with 1: what follows says nothing.
int decimals_of(double error) {
  constexpr double kTwoDigits = 1.95, kMost = 6;
  const double place = std::floor(std::log10(error));
  const double decimals = error / std::pow(10.0, place) < kTwoDigits ? 1 - place : -place;
  return static_cast<int>(std::clamp(decimals, 0.0, kMost));
}

// "0.3822±0.0004".
std::string error_cell(const ChannelStatistics& s, std::size_t c, int digits) {
  if (c >= s.standard_error.size() || !std::isfinite(s.standard_error[c]))
    return value_cell(s.mean, c, digits);
  const double error = s.standard_error[c];
  if (error > 0) digits = decimals_of(error);
  return fmt::format("{}±{:.{}f}", value_cell(s.mean, c, digits), error, digits);
}

// Mean over the channels of a quantity of the data sheet, in whatever unit.
std::string mean_with_error(const char* name, const Values& values, const Values& errors,
                            double factor) {
  const ChannelMean mean = channel_mean({name, "", "", "", values, errors});
  if (errors.empty()) return fmt::format("{:.3g}", factor * mean.value);
  return error_cell({{factor * mean.value}, {factor * mean.standard_error}, {}, {}, {}}, 0, 3);
}

using Table = std::vector<std::vector<std::string>>;

// As it is seen: ± is one column.
std::size_t columns_of(const std::string& text) {
  return as_index(std::count_if(text.begin(), text.end(), [](char c) {
    return (static_cast<unsigned char>(c) & 0xC0) != 0x80;
  }));
}

// Columns are as wide as their widest cell. Contract: all rows have as many.
void add_table(Lines& lines, const Table& table) {
  std::vector<std::size_t> width(table.front().size(), 0);
  for (const auto& row : table)
    for (std::size_t i = 0; i < width.size(); ++i)
      width[i] = std::max(width[i], columns_of(row[i]));
  for (const auto& row : table) {
    std::string line;
    for (std::size_t i = 0; i < width.size(); ++i)
      line += std::string(2 + width[i] - columns_of(row[i]), ' ') + row[i];
    lines.add("{}", line.substr(0, line.find_last_not_of(' ') + 1));
  }
}

void add_sensor(Lines& lines, const NoiseModel& m) {
  lines.add("{}", m.sensor.empty() ? "unnamed sensor" : m.sensor);
  lines.add("  layout     {} ({})", m.layout.name(), counted(m.layout.channels(), "channel"));
  lines.add("  black      {} DN (mean of the channels), white {:g} DN, step {:g} DN",
            mean_cell(m.black_dn, 2), m.white_dn, m.quantization_dn);
  lines.add("  row group  {} ({})", m.row_group, m.row_group_origin);
  lines.add("  kinds      {}", joined(model_kind_names(m.kinds())));
  lines.add("  origin     {}", m.origin.empty() ? "not stated" : m.origin);
  if (!m.defects.empty()) lines.add("  defects    {}", counted(std::ssize(m.defects), "pixel"));
}

void add_summary(Lines& lines, const NoiseModel& m) {
  lines.add("\nPhysics, means over the channels");
  Table table{{"gain", "frames", "K", "read", "read", "lambda", "mu", "row", "dark sd"},
              {"", "", "DN/e-", "e-", "DN", "", "DN", "DN", "DN"}};
  for (const PhysicsCalibration& p : m.physics)
    table.push_back({p.gain.text(), p.bias_frames > 0 ? std::to_string(p.bias_frames) : "-",
                     mean_cell(p.K.mean, 4), mean_cell(read_noise_e(p), 2),
                     mean_cell(read_noise_dn(p), 3), mean_cell(p.lambda.mean, 3),
                     mean_cell(p.mu.mean, 3), mean_cell(p.sigma_row.mean, 3),
                     mean_cell(p.temporal_sd_dark_dn, 3)});
  add_table(lines, table);
}

void add_warnings(Lines& lines, const std::vector<std::string>& warnings, StoredWarnings shown) {
  if (shown == StoredWarnings::kLeftOut) return;
  for (const std::string& warning : warnings) lines.add("  warning: {}", warning);
}

void add_channels(Lines& lines, const NoiseModel& m, const PhysicsCalibration& p,
                  StoredWarnings warnings) {
  if (p.bias_frames > 0)
    lines.add("\n{}: {}, {}; value ± standard error", p.gain.text(),
              counted(p.bias_frames, "bias frame"), counted(p.flat_levels, "flat level"));
  else
    lines.add("\n{}: stated, not measured from frames here", p.gain.text());
  Table table{{"channel", "K", "read noise", "lambda", "sigma_TL", "mu", "sigma_row", "dark sd"},
              {"", "DN/e-", "e-", "", "DN", "DN", "DN", "DN"}};
  const ChannelStatistics read{read_noise_e(p), read_noise_stderr_e(p), {}, {}, {}};
  for (int channel = 0; channel < m.layout.channels(); ++channel) {
    const auto c = as_index(channel);
    table.push_back({m.layout.channel_name(channel), error_cell(p.K, c, 4), error_cell(read, c, 3),
                     error_cell(p.lambda, c, 3), error_cell(p.sigma_tl, c, 4),
                     error_cell(p.mu, c, 4), error_cell(p.sigma_row, c, 4),
                     value_cell(p.temporal_sd_dark_dn, c, 3)});
  }
  add_table(lines, table);
  if (!p.dsnu_dn.empty())
    lines.add(
        "  fixed pattern: DSNU {} DN{}", mean_with_error("dsnu", p.dsnu_dn, p.dsnu_stderr_dn, 1),
        p.prnu.empty()
            ? ""
            : fmt::format(", PRNU {} %", mean_with_error("prnu", p.prnu, p.prnu_stderr, 100)));
  if (!p.row_drift.drift.white()) lines.add("  rows drift slowly: {}", text_of(p.row_drift));
  add_warnings(lines, p.warnings, warnings);
}

// Rows of one parameter: means over the channels whose logarithm was fitted, and over those that
// were fitted themselves.
void add_law(const std::string& name, const std::vector<LogLinear>& laws, Table& table) {
  for (const bool is_signed : {false, true}) {
    Values slope, intercept, residual;
    for (const LogLinear& law : laws) {
      if (law.signed_linear != is_signed) continue;
      slope.push_back(law.slope);
      intercept.push_back(law.intercept);
      residual.push_back(law.residual_sd);
    }
    if (!slope.empty())
      table.push_back({"", is_signed ? name : fmt::format("log({})", name), mean_cell(slope, 3),
                       mean_cell(intercept, 3), mean_cell(residual, 3)});
  }
}

std::string gain_text(double db, bool in_iso) { return GainSetting::at_decibel(db, in_iso).text(); }

void add_joint(Lines& lines, const JointGainModel& joint, bool in_iso) {
  lines.add("\nJoint model over gain: y = slope log K + intercept, means over the channels");
  for (const JointSegment& s : joint.segments) {
    if (s.knots_db.size() < 2) {
      lines.add("  {}, K {:.4g} DN/e-: one gain, with no other to go to",
                gain_text(s.knots_db.front(), in_iso), std::exp(s.log_K_low()));
      continue;
    }
    lines.add("  {} to {}, K {:.4g} to {:.4g} DN/e-: K x{:.4f} per 6 dB",
              gain_text(s.knots_db.front(), in_iso), gain_text(s.knots_db.back(), in_iso),
              std::exp(s.log_K_low()), std::exp(s.log_K_high()), std::exp(6.0 * s.K_of_gain.slope));
    Table table{{"", "y", "slope", "intercept", "residual"}};
    for (const auto& [name, laws] :
         {std::pair("-mu", &s.minus_mu), std::pair("variance of mu", &s.mu_variance),
          std::pair("sigma_row", &s.sigma_row),
          std::pair("variance of s_row", &s.sigma_row_variance), std::pair("sigma_TL", &s.sigma_tl),
          std::pair("spread of s_TL", &s.sigma_tl_spread)})
      add_law(name, *laws, table);
    add_table(lines, table);
  }
  for (const auto& note : joint.notes) lines.add("  note: {}", note);
}

void add_other_kinds(Lines& lines, const NoiseModel& m, StoredWarnings warnings) {
  for (const auto& g : m.gaussian) {
    lines.add("\nGaussian, {}: variance = {} DN x signal + {} DN^2 (means over the channels)",
              g.gain.text(), mean_cell(g.slope_dn, 4), mean_cell(g.offset_dn2, 3));
    add_warnings(lines, g.warnings, warnings);
  }
  for (const auto& n : m.nonparametric) {
    lines.add("\nNon-parametric, {}: {}, {} levels of {} bins in the first channel, rows {} DN",
              n.gain.text(), counted(n.frames, "frame"), n.channels[0].level_dn.size(),
              n.channels[0].bin_edges_dn.size() - 1, mean_cell(n.sigma_row_dn, 3));
    if (!n.row_drift.drift.white()) lines.add("  rows drift slowly: {}", text_of(n.row_drift));
    add_warnings(lines, n.warnings, warnings);
  }
  for (const auto& bank : m.dark_frames)
    lines.add("\nDark frames, {}: {} of {} x {}", bank.gain.text(), bank.frames_dn.size(),
              bank.frames_dn[0].cols(), bank.frames_dn[0].rows());
}

}  // namespace

std::string model_text(const NoiseModel& model, StoredWarnings warnings) {
  Lines lines;
  add_sensor(lines, model);
  add_warnings(lines, model.warnings, warnings);
  if (!model.physics.empty()) {
    if (model.physics.size() > 1) add_summary(lines, model);
    if (model.physics.size() <= kMaxChannelTables)
      for (const PhysicsCalibration& p : model.physics) add_channels(lines, model, p, warnings);
    else
      lines.add("\nOne gain by channel: --gain or --iso");
  }
  if (model.joint) add_joint(lines, *model.joint, model.physics[0].gain.iso.has_value());
  add_other_kinds(lines, model, warnings);
  return lines.text();
}

}  // namespace malus::app
