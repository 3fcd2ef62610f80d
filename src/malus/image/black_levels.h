// Black levels per channel: one number for all of them, or one each; and what becomes of them where
// a frame's layout changes.
#pragma once

#include "malus/image/raw_frame.h"

#include <string>
#include <string_view>
#include <vector>

namespace malus {

/// One level per channel, from that many or from one for all. Throws InputError naming the source.
std::vector<double> black_per_channel(const std::vector<double>& values, const SensorLayout& layout,
                                      const std::string& source);

/// The black levels, one per channel of `own`, of a frame that is given another layout: black
/// belongs to a place in the sensor's cell, whatever its colour is called. Throws InputError naming
/// the source where places of one new channel have unlike blacks.
std::vector<double> blacks_for_layout(const std::vector<double>& blacks, const SensorLayout& own,
                                      const SensorLayout& layout, const std::string& source);
std::vector<double> blacks_for_layout(const RawFrame& frame, const SensorLayout& layout);

/// The black level of every channel of frames taken in the dark, at one gain: the mean of their
/// pixels that are numbers, black and bias in one. Throws InputError naming a frame of another
/// layout or gain than the first one's, one whose mean lies above a quarter of white, which is not
/// dark, and one without a number in some channel. Contract: there is a frame.
class DarkLevels {
 public:
  void add(const RawFrame& dark);
  std::vector<double> black_dn() const;
  /// Of the frames, as far as they tell it.
  const GainSetting& gain() const { return gain_; }

 private:
  SensorLayout layout_;
  GainSetting gain_;
  std::vector<double> sum_;  ///< per channel, of the frames' means
  int frames_ = 0;
};

/// Throws InputError naming the frame where it has not one black level per channel, a level is not
/// finite, or a black level not below white.
/// Of float pixels of unknown white, which then is the largest of them, black may be above it.
void require_levels(const RawFrame& frame);

/// Throws InputError naming the frame where a black level is negative and the pixels are of a type
/// ("uint16", "bool"; anything of floats) that is not: a sign slipped in.
void require_black_of_codes(const RawFrame& frame, std::string_view type);

}  // namespace malus
