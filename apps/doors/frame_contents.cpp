#include "frame_contents.h"

#include "malus/base/error.h"
#include "malus/base/statistics.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/denoise/cut_off.h"
#include "malus/image/frame_statistics.h"
#include "malus/io/picture_file.h"
#include "malus/noise/raw_variance.h"
#include "malus/noise/same_sensor.h"
#include "malus/polar/layout_check.h"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

namespace malus::app {
namespace {

StatedLevels with_true_black(const RawFrame& told, const FrameOptions& options,
                             FloatBlack float_black) {
  const bool tells_above = told.black_known && mean_of(told.black_dn) == 0;
  if (options.black_dn.empty() || told.holds_codes() || (told.black_known && !tells_above) ||
      (float_black == FloatBlack::kHolds && !tells_above))
    return {options, {}};
  StatedLevels levels{options, {}};
  const double stated_dn = mean_of(options.black_dn);
  if (float_black == FloatBlack::kHolds && stated_dn != 0)
    levels.warning =
        fmt::format("says that it is above black; {} is not subtracted", setting("black"));
  if (float_black == FloatBlack::kNotSaid && !tells_above && stated_dn != 0)
    levels.warning =
        fmt::format("float pixels are taken as DN above black, give {} if they hold the camera's",
                    setting("black", stated_dn));
  FrameOptions& above = levels.options;
  above.black_dn.clear();
  if (above.white_dn) above.white_dn = white_above_black(*above.white_dn, options.black_dn);
  if (!tells_above) above.black_dn = {0.0};
  return levels;
}

void require_numbers(std::int64_t odd, std::size_t pixels, const std::string& source) {
  if (odd > 0 && static_cast<std::size_t>(odd) == pixels)
    throw InputError(source, "all pixels are NaN or infinite", "check how it was made");
}

std::string complaint_of(std::int64_t odd, const std::string& source, std::string_view what_comes) {
  if (odd == 0) return {};
  return fmt::format("{}: {} NaN or infinite; {}", source, counted_are(odd, "pixel"), what_comes);
}

}  // namespace

StatedLevels levels_for_frame(const RawFrame& told, const std::string& holds,
                              const FrameOptions& options, FloatBlack float_black) {
  StatedLevels levels = with_true_black(told, options, float_black);
  const bool of_result = holds == kHoldsDenoised && told.white_known;
  if (!of_result || !levels.options.white_dn || float_black == FloatBlack::kAboveAlready)
    return levels;
  const double stated_dn = *levels.options.white_dn;
  levels.options.white_dn.reset();
  const bool by_session = float_black == FloatBlack::kNotSaid && !options.black_dn.empty();
  if (!by_session && stated_dn != told.white_dn)
    levels.warning +=
        fmt::format("{}says that it is saturated at {:g} DN; {} is not taken",
                    levels.warning.empty() ? "" : ", and ", told.white_dn, setting("white"));
  return levels;
}

StatedLevels levels_for_file(const std::filesystem::path& path, const FrameOptions& options,
                             FloatBlack float_black) {
  if (options.black_dn.empty() && !options.white_dn) return {options, {}};
  FrameOptions own_word = options;
  own_word.black_dn.clear();
  own_word.white_dn.reset();
  own_word.layout.reset();  // in another one, its black levels may have no place
  const FrameInfo told = probe_frame(path, own_word);
  return levels_for_frame(told.frame, told.holds, options, float_black);
}

void require_raw(const std::string& source, const std::string& holds, const std::string& remedy) {
  if (holds == kHoldsDenoised)
    throw InputError(
        source, fmt::format("is denoised: {} states the noise of raw frames", setting("model")),
        remedy);
}

std::int64_t nonfinite_pixels(View<const float> dn, const std::string& source) {
  std::int64_t odd = 0;
  for (int r = 0; r < dn.rows(); ++r)
    odd += std::count_if(dn.row(r), dn.row(r) + dn.cols(),
                         [](float value) { return !std::isfinite(value); });
  const auto pixels = static_cast<std::size_t>(dn.rows()) * static_cast<std::size_t>(dn.cols());
  require_numbers(odd, pixels, source);
  return odd;
}

std::string nonfinite_complaint(View<const float> dn, const std::string& source,
                                std::string_view what_comes) {
  return complaint_of(nonfinite_pixels(dn, source), source, what_comes);
}

std::string nonfinite_light_complaint(std::int64_t count, std::size_t pixels,
                                      const std::string& source) {
  require_numbers(count, pixels, source);
  return complaint_of(count, source, "taken as dark");
}

std::vector<float> take_as_light(RawFrame& frame) {
  if (!frame.holds_codes()) frame.black_known = true;
  const std::vector<float> saturated_dn = saturation_dn(frame);
  subtract_black(frame);
  return saturated_dn;
}

std::string unknown_layout_complaint(const RawFrame& frame) {
  if (frame.layout_known) return {};
  return fmt::format(
      "layout not known, taken as {}; a colour or polarization mosaic needs its own ({})",
      frame.layout.name(), setting("layout"));
}

std::string unknown_black_complaint(const RawFrame& frame) {
  if (frame.black_known) return {};
  return fmt::format("black level not known, taken as 0{} ({})",
                     frame.layout.polarized() ? "; DoLP is too low if it is not" : "",
                     setting("black"));
}

std::vector<std::string> guess_complaints(const RawFrame& frame) {
  std::vector<std::string> complaints;
  complaints.push_back(unknown_layout_complaint(frame));
  complaints.push_back(layout_complaint(frame.layout, check_layout(frame.dn)));
  complaints.push_back(level_complaint(frame));
  complaints.push_back(declaration_note(frame));
  complaints.push_back(unknown_black_complaint(frame));
  const double range_dn = white_above_black(frame.white_dn, frame.black_dn);
  if (!frame.white_known && frame.bits > 0 && range_dn <= 0)
    complaints.push_back(
        fmt::format("white level not known, and no pixel lies above black ({})", setting("white")));
  else if (!frame.white_known && frame.bits > 0)
    complaints.push_back(fmt::format(
        "white level not known, taken as {:g} DN above black; saturated pixels go unnoticed if it "
        "is lower ({})",
        range_dn, setting("white")));
  std::erase(complaints, std::string());
  return complaints;
}

std::vector<std::string> mean_complaints(const RawFrame& mean) {
  std::vector<std::string> complaints = {unknown_layout_complaint(mean)};
  if (mean.holds_codes() && !mean.black_known)
    complaints.push_back(
        fmt::format("black level not known; give {}, or a model later", setting("black")));
  if (mean.holds_codes() && !mean.white_known)
    complaints.push_back(
        fmt::format("white level not known; what is saturated in some of the frames goes "
                    "unnoticed ({})",
                    setting("white")));
  std::erase(complaints, std::string());
  return complaints;
}

std::string cut_off_note(const RawFrame& frame) {
  constexpr double kMost = 0.001;
  const double share = measure_cut_off(frame).mean_share();
  if (!(share > kMost)) return {};
  return fmt::format("noise took {} % of its pixels to 0, where the camera cuts it off",
                     percent_text(share));
}

std::string cut_off_of_mean_note(const RawFrame& frame) {
  const std::string note = cut_off_note(frame);
  if (note.empty()) return {};
  return note +
         ": dark places of the mean are too bright; denoise takes that back of single frames only";
}

std::string no_light_complaint(std::span<const StokesPlanes> planes, bool whole) {
  std::size_t dark = 0, all = 0;
  for (const StokesPlanes& color : planes) {
    dark += static_cast<std::size_t>(
        std::ranges::count_if(color.s0.values(), [](float s0) { return s0 <= 0; }));
    all += color.s0.size();
  }
  if (2 * dark <= all) return {};
  return fmt::format(
      "no light above black in {} % of the {}: DoLP and AoLP are undefined there; check {}",
      percent_text(static_cast<double>(dark) / static_cast<double>(all)),
      whole ? "pixels" : "cells", setting("black"));
}

std::string_view fate_of_nonfinite(bool as_float) {
  return as_float ? "kept as read" : "as integers 0 or white";
}

std::string_view fate_in_polarization() { return "S0, DoLP and AoLP are wrong or undefined there"; }

std::string_view fate_in_guide(const std::string& method, bool as_float) {
  return method == "naive" ? fate_of_nonfinite(as_float) : "no noise is added there";
}

bool shows_noisy_frame(const std::string& method, bool guide_given) {
  return method != "naive" || !guide_given;
}

}  // namespace malus::app
