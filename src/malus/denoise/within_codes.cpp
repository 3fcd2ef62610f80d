#include "malus/denoise/internal/within_codes.h"

#include "malus/noise/rounding.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace malus::internal {
namespace {

// All measured (docs/denoising-experiments.md, "Between two codes").
constexpr double kWorthTelling = 1.1;  // times the noise that the profile tells
constexpr double kFewestSquares = 100;
// Squares that hold three codes, over those that hold two: even light has fewer than the first,
// texture more than the second.
constexpr double kOfEvenLight = 0.05, kOfTexture = 0.1;

// Times the variance of as many samples of one place as have the upper code: even light shows no
// more, texture that alternates from pixel to pixel does.
constexpr double kAlternating = 1.1;

// 2x2 neighbours of a channel, of a code and the next one: their second differences along the
// diagonals, in which edges and slopes cancel, show the noise alone.
struct CodeSquares {
  double squared = 0;  // differences of unit noise, in steps
  double all = 0;      // in the two codes
  double upper = 0;    // the same, of each the share of its pixels that have the upper code
  double two = 0;      // in both of them
  double three = 0;    // one code more
};

// Codes are counted from white, which is one.
class CodePlaces {
 public:
  CodePlaces(const PreparedFrame& frame, double step_dn) : step_dn_(step_dn) {
    for (const float white_dn : frame.saturated_dn) {
      const auto codes = static_cast<std::size_t>(std::ceil(double{white_dn} / step_dn));
      white_dn_.push_back(white_dn);
      squares_.emplace_back(codes + kBelow + kAbove);
    }
    const int down = frame.layout.rows(), across = frame.layout.cols();
    for (int r = 0; r + down < frame.dn.rows(); ++r) {
      if (r / down % 2 != 0) continue;
      const float *upper = frame.dn.row(r), *lower = frame.dn.row(r + down);
      for (int c = 0; c + across < frame.dn.cols(); ++c)
        if (c / across % 2 == 0)
          add(static_cast<std::size_t>(frame.layout.channel_at(r, c)),
              {upper[c], upper[c + across], lower[c], lower[c + across]});
    }
  }

  /// Of light between the code below this signal and the one above: told_dn2, or as much more as
  /// the frame shows, up to most_dn2.
  double variance_dn2(std::size_t channel, double signal_dn, double told_dn2,
                      double most_dn2) const {
    const std::ptrdiff_t at =
        index(channel, std::floor((signal_dn - white_dn_[channel]) / step_dn_));
    if (at < 0) return told_dn2;
    const CodeSquares& here = squares_[channel][static_cast<std::size_t>(at)];
    if (here.all < kFewestSquares) return told_dn2;
    const double shown = here.squared / here.all, upper = here.upper / here.all,
                 shown_dn2 = std::min(step_dn_ * step_dn_ * shown, most_dn2);
    if (shown_dn2 < kWorthTelling * told_dn2 || shown > kAlternating * upper * (1 - upper))
      return told_dn2;
    const double mixed = here.three / std::max(here.two, 1.0);
    return told_dn2 + std::clamp((kOfTexture - mixed) / (kOfTexture - kOfEvenLight), 0.0, 1.0) *
                          (shown_dn2 - told_dn2);
  }

 private:
  // Codes below black and above white that noise reaches.
  static constexpr int kBelow = 16, kAbove = 16;

  // Of a code counted from white; -1 beyond what is kept.
  std::ptrdiff_t index(std::size_t channel, double code) const {
    const auto size = static_cast<double>(squares_[channel].size());
    const double at = code + size - kAbove;
    return at >= 1 && at + 2 < size ? static_cast<std::ptrdiff_t>(at) : -1;
  }

  void add(std::size_t channel, const std::array<float, 4>& dn) {
    std::array<double, 4> codes{};
    for (std::size_t i = 0; i < codes.size(); ++i)
      codes[i] = std::round((dn[i] - white_dn_[channel]) / step_dn_);
    const auto [low, high] = std::minmax_element(codes.begin(), codes.end());
    const std::ptrdiff_t at = index(channel, *low);
    if (at < 0 || *high - *low > 2) return;
    CodeSquares* const here = &squares_[channel][static_cast<std::size_t>(at)];
    if (*high - *low > 1) {
      ++here[0].three;
      ++here[1].three;
      return;
    }
    const double detail = 0.5 * (codes[0] - codes[1] - codes[2] + codes[3]);
    here[0].squared += detail * detail;
    ++here[0].all;
    if (*high > *low) {
      ++here[0].two;
      for (const double code : codes) here[0].upper += 0.25 * (code - *low);
      return;
    }
    // Of one code, which is the upper one of the pair below.
    ++here[-1].all;
    ++here[-1].upper;
  }

  double step_dn_;
  std::vector<double> white_dn_;                   // [channel]
  std::vector<std::vector<CodeSquares>> squares_;  // [channel][code]
};

// What rounding makes of the noise between two codes.
double most_between(double step_dn, double told_dn2) {
  const double step2 = step_dn * step_dn;
  return rounded_variance(step_dn, step_dn / 2, std::max(told_dn2 - step2 / 12, 1e-6 * step2));
}

bool is_more(double most_dn2, double told_dn2) { return most_dn2 > kWorthTelling * told_dn2; }

// Knots on codes and in the middle between two.
VarianceCurve raised_curve(const VarianceCurve& told, const CodePlaces& places, std::size_t channel,
                           double step_dn, double white_dn, double highest_dn, bool& is_raised) {
  std::vector<double> signal_dn, variance_dn2;
  double more_below = 0;
  for (double dn = white_dn - std::ceil(white_dn / step_dn) * step_dn; dn < highest_dn + step_dn;
       dn += step_dn) {
    const double middle_dn = dn + step_dn / 2, told_dn2 = told(middle_dn),
                 most_dn2 = most_between(step_dn, told_dn2);
    const double more = is_more(most_dn2, told_dn2)
                            ? places.variance_dn2(channel, middle_dn, told_dn2, most_dn2) - told_dn2
                            : 0.0;
    is_raised = is_raised || more > 0;
    signal_dn.insert(signal_dn.end(), {dn, middle_dn});
    variance_dn2.insert(variance_dn2.end(),
                        {told(dn) + std::max(more_below, more), told_dn2 + more});
    more_below = more;
  }
  return VarianceCurve::table(std::move(signal_dn), std::move(variance_dn2),
                              told.is_affine() ? told.slope_dn() : 0.0);
}

}  // namespace

NoiseProfile with_noise_between_codes(NoiseProfile profile, const PreparedFrame& frame) {
  constexpr double kMostCodes = 1 << 20;
  const double step_dn = profile.step_dn;
  const auto may_show_more = [step_dn, &frame](const ChannelProfile& channel) {
    const double told_dn2 = channel.variance(0);
    return frame.highest_dn < kMostCodes * step_dn &&
           is_more(most_between(step_dn, told_dn2), told_dn2) &&
           !(channel.law && channel.law->is_clipped());
  };
  if (profile.estimated_from_picture || !(step_dn > 0) ||
      std::none_of(profile.channels.begin(), profile.channels.end(), may_show_more))
    return profile;
  const CodePlaces places(frame, step_dn);
  for (std::size_t k = 0; k < profile.channels.size(); ++k) {
    ChannelProfile& channel = profile.channels[k];
    bool is_raised = false;
    if (!may_show_more(channel)) continue;
    VarianceCurve variance =
        raised_curve(channel.variance, places, k, step_dn, double{frame.saturated_dn[k]},
                     frame.highest_dn, is_raised);
    if (!is_raised) continue;
    channel.variance = std::move(variance);
    channel.law.reset();  // that of the lower noise
  }
  return profile;
}

}  // namespace malus::internal
