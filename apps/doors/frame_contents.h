// What the values of a frame are by its own word, against what is stated of it.
#pragma once

#include "malus/io/frame_file.h"
#include "malus/polar/stokes.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace malus::app {

/// What a stated black level means for a float file that does not tell its own.
enum class FloatBlack {
  kAboveAlready,  ///< nothing but that white lies as much higher: one flag serves raw and results
  kNotSaid,       ///< the same, but a session states it: that is said
  kHolds,         ///< --black: the file holds it, as the mean of raw frames does
};

/// What is stated of a frame, as far as it is true, and what to warn of (without the frame's name;
/// empty where there is nothing).
struct StatedLevels {
  FrameOptions options;
  std::string warning;
};

/// The options as they are true of a file: a float file that says that it is above black is, and so
/// is one that does not tell its black level (interface: malus writes them so) unless float_black
/// says that it holds it. A denoised file is saturated where it says, below the camera's white by
/// the bias that was taken off; but for kAboveAlready, where white is the peak.
StatedLevels levels_for_file(const std::filesystem::path& path, const FrameOptions& options,
                             FloatBlack float_black);
/// The same of a frame that is loaded, `told` all that it tells of itself (holds: FrameInfo).
StatedLevels levels_for_frame(const RawFrame& told, const std::string& holds,
                              const FrameOptions& options, FloatBlack float_black);

/// Throws InputError for a frame whose file says that it is denoised (holds): a model's noise and
/// bias are no longer in it.
void require_raw(const std::string& source, const std::string& holds, const std::string& remedy);

/// What a frame that says so is told where a filter takes its noise from itself.
inline constexpr const char* kDenoisedAgain =
    "says that it is denoised: what is left of its noise is not what is estimated; denoise the raw "
    "frame";

/// How many pixels are no numbers. Throws InputError naming the source where all are such.
std::int64_t nonfinite_pixels(View<const float> dn, const std::string& source);
/// The same and what comes of them, as a warning; empty where all are numbers. Throws as above.
std::string nonfinite_complaint(View<const float> dn, const std::string& source,
                                std::string_view what_comes);
/// The same of the light of a picture (linear_light, malus/synthesize/scene.h), of which `count`
/// of `pixels` are no numbers.
std::string nonfinite_light_complaint(std::int64_t count, std::size_t pixels,
                                      const std::string& source);
/// What comes of such pixels, in results that are kept as they are or rounded to integers.
std::string_view fate_of_nonfinite(bool as_float);
/// The same where polarization is worked out.
std::string_view fate_in_polarization();
/// The same of those in the guide of renoise, by its method.
std::string_view fate_in_guide(const std::string& method, bool as_float);
/// Whether renoise's result holds the noisy frame: new noise on a given guide does not.
bool shows_noisy_frame(const std::string& method, bool guide_given);

/// Takes the black level off a frame that is to be light; floats are light already, with a black
/// level of 0 that is known. Returns saturation_dn of the frame as it was.
std::vector<float> take_as_light(RawFrame& frame);

/// What a frame above black was taken for without anybody having stated it, layout, black and white
/// level, and where its pixels or its file contradict the layout: warnings without its name.
std::vector<std::string> guess_complaints(const RawFrame& frame);
/// The one of the layout; empty where it is known.
std::string unknown_layout_complaint(const RawFrame& frame);
/// The one of the black level, which matters to comparisons as well; empty where it is known.
std::string unknown_black_complaint(const RawFrame& frame);

/// What a mean of frames (image/frame_mean.h) lacks that its use will ask for: warnings without its
/// name.
std::vector<std::string> mean_complaints(const RawFrame& mean);

/// "noise took 2 % of its pixels to 0, where the camera cuts it off"; empty where that is less than
/// a thousandth of them.
std::string cut_off_note(const RawFrame& frame);
/// The same with what it makes of a mean of such frames.
std::string cut_off_of_mean_note(const RawFrame& frame);

/// That most cells, or most pixels (whole), have no light, for which a wrong black level is often
/// the reason; empty where they have. planes: of every colour.
std::string no_light_complaint(std::span<const StokesPlanes> planes, bool whole);

}  // namespace malus::app
