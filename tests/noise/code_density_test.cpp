// Noise inside the codes of a converter. Truth: normal noise, of which the codes' probabilities
// are known in closed form.
#include "malus/noise/code_density.h"

#include "malus/base/normal_distribution.h"
#include "malus/noise/level_noise.h"

#include <cmath>

#include <gtest/gtest.h>

namespace malus {
namespace {

constexpr double kSigma = 0.6, kMean = 0.2, kBlack = 10.3;
constexpr int kParts = 10, kReach = 6;  // of a code; codes to either side

double below(double dn) { return normal_cdf((dn - kMean) / kSigma); }

// Codes k, at k - kBlack, from boundary to boundary in kParts bins. smooth: the truth, else even
// inside each code.
NonparametricChannel dark_channel(bool smooth) {
  NonparametricChannel channel;
  channel.level_dn = {0, 100};
  channel.samples = {1000, 1000};
  channel.pmf.resize(2);
  for (int code = 10 - kReach; code <= 10 + kReach; ++code)
    for (int j = 0; j < kParts; ++j) {
      const double begin = code - 0.5 - kBlack, from = begin + j / double{kParts},
                   to = begin + (j + 1) / double{kParts};
      channel.bin_edges_dn.push_back(from);
      channel.pmf[0].push_back(smooth ? below(to) - below(from)
                                      : (below(begin + 1) - below(begin)) / kParts);
      channel.pmf[1].push_back(1.0 / ((2 * kReach + 1) * kParts));
    }
  channel.bin_edges_dn.push_back(10 + kReach + 0.5 - kBlack);
  return channel;
}

double code_probability(const NonparametricChannel& channel, int code) {
  double sum = 0;
  for (int j = 0; j < kParts; ++j)
    sum += channel.pmf[0][static_cast<std::size_t>((code - 10 + kReach) * kParts + j)];
  return sum;
}

// Even inside the codes the variance is larger by a sixth of a code squared: half of it is the
// rounding's, half the codes' own width.
TEST(SmoothInsideCodes, TakesTheCodesWidthOutAndKeepsTheirProbabilities) {
  const NonparametricChannel even = dark_channel(false);
  EXPECT_NEAR(level_moments(even, 0).variance_dn2, kSigma * kSigma + 1.0 / 6, 2e-3);
  const NonparametricChannel found = smooth_inside_codes(even, kBlack, 1.0);
  EXPECT_NEAR(level_moments(found, 0).variance_dn2, kSigma * kSigma, 0.01 * kSigma * kSigma);
  EXPECT_NEAR(level_moments(found, 0).mean_dn, kMean, 2e-3);
  for (int code = 10 - kReach; code <= 10 + kReach; ++code)
    EXPECT_NEAR(code_probability(found, code), code_probability(even, code), 1e-12) << code;
  EXPECT_EQ(found.pmf[1], even.pmf[1]);
}

TEST(SmoothInsideCodes, LeavesWhatIsSmooth) {
  const NonparametricChannel smooth = dark_channel(true);
  const NonparametricChannel found = smooth_inside_codes(smooth, kBlack, 1.0);
  for (std::size_t b = 0; b < found.pmf[0].size(); ++b)
    EXPECT_NEAR(found.pmf[0][b], smooth.pmf[0][b], 1e-9) << b;
}

TEST(SmoothInsideCodes, LeavesWhatHasNoCodes) {
  NonparametricChannel channel = dark_channel(false);
  EXPECT_EQ(smooth_inside_codes(channel, kBlack, 0), channel);
  EXPECT_EQ(smooth_inside_codes(channel, kBlack, 1e-9), channel);  // more codes than anyone counts
  channel.level_dn = {5, 100};
  EXPECT_EQ(smooth_inside_codes(channel, kBlack, 1.0), channel);
}

}  // namespace
}  // namespace malus
