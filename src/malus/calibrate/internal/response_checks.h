// What the flats' light and the pixels' response say against the layout and the lit surface.
#pragma once

#include "malus/calibrate/geometry.h"
#include "malus/calibrate/internal/response.h"
#include "malus/image/layout.h"
#include "malus/noise/calibration.h"

#include <vector>

namespace malus {

/// light_dn: [level][channel], above dark. Appends a warning to `out` where the declared colours
/// contradict them, of three levels or more: all colours see the same light to 0.3 % (a sensor
/// without colour filters), or the two greens differ by more than 3 % and three times as much as
/// red and blue do (another order). Polarizers' angles are alike in unpolarized light.
void warn_of_colors(const SensorLayout& layout, const std::vector<std::vector<double>>& light_dn,
                    PhysicsCalibration& out);

/// light_dn as above. Appends a warning where the declared angles contradict Malus's law, by which
/// crossed pairs see the same light, I0 + I90 = I45 + I135, however it is polarized: they differ by
/// more than 5 %, and twice as much as another pairing. Unpolarized light tells nothing.
void warn_of_angles(const SensorLayout& layout, const std::vector<std::vector<double>>& light_dn,
                    PhysicsCalibration& out);

/// How much of a channel's response is no white noise: means over the channels.
struct ResponsePattern {
  double variance = 0;  ///< square of the PRNU
  double periodic = 0;  ///< of it, what repeats every `period` rows and columns of the channel
  int period = 0;       ///< 2 or 4
  double periodic_stderr = 0;  ///< what chance makes of it where nothing repeats
  double neighbours = 0;       ///< of the rest, covariance of next pixels, and its standard error
  double neighbours_stderr = 0;
};
ResponsePattern response_pattern(const Response& response, const MosaicGeometry& geometry);

/// Appends a warning where a quarter or more of the PRNU's square repeats every few pixels (0.3 %
/// or more of the light, and eight standard errors): pixels of several colours in one channel, or
/// columns with gains of their own. Else where next pixels share more than a tenth of the rest, but
/// for what whole rows and columns share, by eight standard errors: a picture of the lit surface,
/// or dust.
void warn_of_response(const ResponsePattern& pattern, const SensorLayout& layout,
                      PhysicsCalibration& out);

/// Appends a warning where there are any.
void warn_of_unlit_lines(const UnlitLines& unlit, PhysicsCalibration& out);

}  // namespace malus
