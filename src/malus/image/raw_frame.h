// A raw mosaic with what is needed to read it as light: black, white, gain, exposure travel with
// the pixels.
#pragma once

#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <optional>
#include <string>
#include <vector>

namespace malus {

/// The camera's amplification as the camera names it; a model keeps the one that was measured.
struct GainSetting {
  std::optional<double> gain_db;  ///< industrial cameras
  std::optional<double> iso;      ///< photo cameras
  bool operator==(const GainSetting&) const = default;
  /// "24 dB", "ISO 1600", "unknown gain"
  std::string text() const;
  /// The number to sort and interpolate by: dB as they are, ISO as 20 log10(iso/100); empty when
  /// unknown.
  std::optional<double> decibel() const;
  /// The setting whose decibel() is db, in ISO or in dB.
  static GainSetting at_decibel(double db, bool in_iso);
  /// Both are known, in one unit, and differ by more than files round them (2 %): another setting.
  bool contradicts(const GainSetting& other) const;
};

/// What goes before a line about some gains, or one kind of model at them: "12 dB: ", "0 dB, 12 dB,
/// Gaussian: ". A camera that tells no gain has one alone, which is not named: empty without a
/// kind.
std::string gain_prefix(const std::vector<GainSetting>& gains, const std::string& kind = "");
inline std::string gain_prefix(const GainSetting& gain, const std::string& kind = "") {
  return gain_prefix(std::vector{gain}, kind);
}

/// ln(K) grows by this per dB of gain: ln(10)/20.
inline constexpr double kLogPerDb = 0.11512925464970229;

/// Largest number of frames that a mean may be of.
inline constexpr int kMostAveraged = 1'000'000;

/// One frame. Pixels are DN as the camera wrote them, black level included, exact in float up to 24
/// bits.
struct RawFrame {
  Image dn;  ///< mosaic, rows x cols
  SensorLayout layout;
  std::vector<double> black_dn;  ///< one per channel of the layout
  double white_dn = 0;           ///< saturation, black level included
  GainSetting gain;
  std::optional<double> exposure_s;
  int bits = 0;     ///< significant bits of integer data; 0 for float data
  int mean_of = 1;  ///< frames of one scene whose mean the pixels are (image/frame_mean.h)
  bool black_known = false, white_known = false,
       layout_known = false;  ///< from file, session or flag, not guessed
  std::string file_layout;    ///< name of the file's own layout where another was declared
  std::string source;         ///< file name, for messages

  /// Pixels are the camera's codes or a mean of them, which hold its black level though nobody
  /// tells it; other floats are above black unless they tell one.
  bool holds_codes() const { return bits > 0 || mean_of > 1; }
  double black_at(int row, int col) const {
    return black_dn[static_cast<std::size_t>(layout.channel_at(row, col))];
  }
};

/// The largest code of this many bits. None of floats (0 bits), nor of types that no camera fills
/// (above 16): where nobody tells it, their white is not known.
std::optional<double> white_of_bits(int bits);

/// What is above all that cameras count, integers of 32 bits: a file's "no data", or a wrong scale.
inline constexpr double kMostCountedDn = 4294967296.0;

/// White where nobody tells it: that of the bits, else the largest pixel of those that can have
/// been counted (where there is none, of all; 0 where none is finite).
double assumed_white_dn(int bits, View<const float> dn);

/// White is no more than the largest pixel: a range, but no sign that this pixel is saturated.
bool white_is_guessed(const RawFrame& frame);

/// White above black: the largest signal that every channel can hold, white less the highest black.
double white_above_black(double white_dn, const std::vector<double>& black_dn);

/// A pixel further outside of black and white than this many times their distance holds no light:
/// it is a file's "no data" (-3.4e38), or what a program divided by nearly 0.
inline constexpr double kMostWhites = 100;

/// Values of pixels that hold light.
struct LightRange {
  float lowest_dn, highest_dn;
  bool holds(float dn) const { return dn >= lowest_dn && dn <= highest_dn; }  // NaN is not
};

/// Within kMostWhites; all that is finite where white is not above black.
LightRange light_range(const RawFrame& frame);

/// Subtracts the black level in place: afterwards pixels and white are DN above black. Nothing is
/// clamped.
void subtract_black(RawFrame& frame);

}  // namespace malus
