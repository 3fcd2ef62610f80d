#include "malus/denoise/denoiser.h"
#include "malus/image/pack.h"
#include "malus/polar/stokes.h"
#include "malus/polar/uncertainty.h"
#include "malus/report/write_report.h"

#include <cmath>
#include <utility>

#include "frame_input.h"
#include "report_pages.h"
#include <fmt/format.h>

namespace malus::app {
namespace {

// Denoising leaves about this part of the noise's deviation: it rules how finely results are
// stored.
constexpr double kDenoisedPart = 0.2;

// Standard deviations of the denoised frame's DoLP and AoLP, of all colours together as the page's
// first pictures of them are.
void add_confidence(const DenoisedFrame& frame, std::size_t pictures, PicturesBlock& block) {
  if (frame.variance_dn2.empty() || !frame.before.layout.polarized()) return;
  const SensorLayout& layout = frame.before.layout;
  const StokesPicture picture =
      merge_greens(stokes_per_color(pack(frame.after_dn, layout), layout), layout);
  StokesUncertainty mean = uncertainty_of_mean(picture, pack(frame.variance_dn2, layout), layout,
                                               Intensities::kDenoised);
  const auto add = [&](const std::string& name, const std::string& unit, double high, Image map) {
    Layer layer{.name = name,
                .unit = unit,
                .text = {},
                .palette = Palette::kSequential,
                .low = 0,
                .high = high,
                .maps = {}};
    layer.maps.resize(pictures);
    layer.maps[1] = std::move(map);
    block.layers.push_back(std::move(layer));
  };
  add("confidence: standard deviation of DoLP", "1", 0.5, std::move(mean.dolp_sd));
  add("confidence: standard deviation of AoLP", "deg", std::sqrt(kUnknownAngleVarianceDeg2),
      std::move(mean.aolp_sd_deg));
}

PicturesBlock pictures(const DenoisedFrame& frame) {
  const RawFrame& before = frame.before;
  PicturesBlock block{.title = std::filesystem::path(before.source).filename().string(),
                      .text =
                          "DN above black. What is shown is computed from the mosaics in this "
                          "file; a value read off with ± is stored in steps of a part of the "
                          "noise to keep the file small.",
                      .layout = before.layout,
                      .rows = before.dn.rows(),
                      .cols = before.dn.cols()};
  block.pictures.push_back({"before", above_black(before), 1});
  block.pictures.push_back({"after", frame.after_dn, kDenoisedPart});
  if (!frame.reference_dn.empty())
    block.pictures.push_back({"reference", frame.reference_dn, kDenoisedPart});
  for (std::size_t c = 0; c < frame.profile.channels.size(); ++c) {
    const ChannelProfile& channel = frame.profile.channels[c];
    const double dark = channel.variance(0);
    const double bright = before.white_dn - before.black_dn[c];
    block.noise.push_back({(channel.variance(bright) - dark) / bright, dark});
    if (channel.gain_dn_per_e > 0) block.gain_dn_per_e.push_back(channel.gain_dn_per_e);
  }
  if (block.gain_dn_per_e.size() != frame.profile.channels.size()) block.gain_dn_per_e.clear();
  block.white_dn = white_above_black(before.white_dn, before.black_dn);
  add_confidence(frame, block.pictures.size(), block);
  return block;
}

TableBlock metrics(const DenoisedFrame& frame) {
  const auto row = [](const std::string& name, const std::vector<Quantity>& metrics) {
    TableBlock::Row made{name, {}};
    for (const Quantity& quantity : metrics)
      made.cells.emplace_back(Measured{quantity.value.front(), Measured::kNone});
    return made;
  };
  TableBlock table{
      .title = "Against the reference",
      .note = {},
      .head = "picture",
      .columns = {},
      .rows = {row("before", frame.metrics_before), row("after", frame.metrics_after)}};
  for (const Quantity& quantity : frame.metrics_after)
    table.columns.push_back({quantity.description, quantity.unit});
  return table;
}

// "R90, R45, …" rather than JSON's brackets; four digits of every number.
std::string words_of(const nlohmann::ordered_json& value) {
  if (value.is_string()) return value.get<std::string>();
  if (value.is_boolean()) return value.get<bool>() ? "yes" : "no";
  if (value.is_number_integer()) return value.dump();
  if (value.is_number()) return fmt::format("{:.4g}", value.get<double>());
  if (!value.is_array()) return value.is_null() ? "unknown" : value.dump();
  std::string words;
  for (const auto& item : value) words += (words.empty() ? "" : ", ") + words_of(item);
  return words;
}

// Settings and timings of a run, whatever they are, as name and value.
void flatten(const nlohmann::ordered_json& json, const std::string& name, TableBlock& table) {
  if (json.is_object()) {
    for (const auto& [key, value] : json.items())
      flatten(value, name.empty() ? key : name + " › " + key, table);
  } else if (json.is_number()) {
    table.rows.push_back({name, {Measured{json.get<double>(), Measured::kNone}}});
  } else {
    table.rows.push_back({name, {words_of(json)}});
  }
}

// What the run said, as its record keeps it; of a record that keeps none (earlier versions), what
// can be told.
NoticesBlock run_warnings(const DenoisedFrame& frame) {
  if (frame.run.contains("warnings")) return warning_notices(frame.run);
  NoticesBlock notices;
  if (frame.profile.estimated_from_picture)
    notices.items.push_back({NoticeLevel::kWarning,
                             "No noise model was given: the noise was estimated from this picture. "
                             "A calibrated model is better."});
  if (!frame.before.black_known)
    notices.items.push_back(
        {NoticeLevel::kWarning, "The black level is not known and taken as 0."});
  return notices;
}

}  // namespace

std::vector<Section> denoise_sections(const DenoisedFrame& frame, const std::string& prefix) {
  const std::string name = std::filesystem::path(frame.before.source).filename().string();
  Section pictures_section{prefix + "pictures", name, {}, {}};
  NoticesBlock notices = run_warnings(frame);
  if (!notices.items.empty()) pictures_section.blocks.emplace_back(std::move(notices));
  if (!frame.reference_dn.empty()) pictures_section.blocks.emplace_back(metrics(frame));
  pictures_section.blocks.emplace_back(pictures(frame));
  TableBlock run{.title = "What was done",
                 .note = {},
                 .head = "setting",
                 .columns = {{"value", "1"}},
                 .rows = {}};
  nlohmann::ordered_json settings = frame.run;
  settings.erase("warnings");
  flatten(settings, "", run);
  if (!run.rows.empty()) pictures_section.blocks.emplace_back(std::move(run));
  return {pictures_section};
}

void write_denoise_report(const std::vector<DenoisedFrame>& frames,
                          const std::filesystem::path& path, bool force) {
  std::vector<Section> sections;
  for (std::size_t i = 0; i < frames.size(); ++i)
    for (Section& section : denoise_sections(frames[i], fmt::format("frame-{}-", i + 1)))
      sections.push_back(std::move(section));
  const std::string title = frames.size() == 1
                                ? "Denoising of " + sections.front().title
                                : fmt::format("Denoising of {} frames", frames.size());
  const std::string subtitle =
      frames.size() != 1 ? ""
                         : fmt::format("{}, {}, {} × {} px", frames[0].before.layout.name(),
                                       frames[0].before.gain.text(), frames[0].before.dn.cols(),
                                       frames[0].before.dn.rows());
  write_report(make_report(title, subtitle, std::move(sections)), path, {.force = force});
}

}  // namespace malus::app
