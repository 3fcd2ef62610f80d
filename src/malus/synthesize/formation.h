// What one pixel of compiled noise needs: plain data that the CPU kernels and the GPU share.
#pragma once

#include "malus/base/random.h"
#include "malus/synthesize/quantile_table.h"

#include <cstdint>
#if !defined(__CUDACC__)
#include <cmath>
#endif

namespace malus {

/// Below this mean (electrons) Poisson draws are summed, above it comes the asymptotic inverse.
inline constexpr float kShotSmall = 5.0f;
/// Terms of the sum at most, a multiple of 4: Poisson(5) exceeds 28 with probability 1e-13.
inline constexpr int kShotSmallMost = 28;
/// Words of the upper tail that double precision redraws: p < 2^-16.
inline constexpr std::uint32_t kShotTailWords = 1u << 16;

enum class ShotKind : std::uint32_t {
  kNone,
  kPoisson,   ///< K Poisson(s/K): physics, Poisson-Gaussian
  kGaussian,  ///< N(0, S max(s, 0) + O): heteroscedastic Gaussian
};

/// The tables and switches that all pixels of a frame share.
struct FormationTables {
  const TailLine* normal = nullptr;  ///< kTailCells lines
  const TailLine* read = nullptr;    ///< kTailCells lines per distinct shape; null = no read noise
  ShotKind shot = ShotKind::kPoisson;
  float quantization_dn = 0;  ///< step of uniform quantisation noise; 0 = none (or rounded later)

  MALUS_HOST_DEVICE bool has_read() const { return read != nullptr; }
  MALUS_HOST_DEVICE bool quantizes() const { return quantization_dn > 0.0f; }
};

/// A group of 32 mosaic columns takes its words from 16 Philox blocks: pixel j < 16 of the group
/// the first two words (shot, read) of block 16 g + j, pixel 16 + j the last two.
inline constexpr int kGroupColumns = 32;

struct PixelWords {
  std::uint32_t shot, read;
};

/// The words of mosaic position (row, col) of a frame: the map that every twin of the kernel keeps.
MALUS_HOST_DEVICE inline PixelWords pixel_words(std::uint64_t seed, std::uint32_t frame, int row,
                                                int col) {
  const auto group = static_cast<std::uint32_t>(col) / kGroupColumns;
  const auto place = static_cast<std::uint32_t>(col) % kGroupColumns;
  const std::uint64_t index = pixel_index(row, static_cast<int>(16u * group + place % 16u));
  const PhiloxBlock block = random_block(seed, frame, index, Draw::kPixel);
  const unsigned half = place / 16u * 2u;
  return {block.word[half], block.word[half + 1]};
}

/// Smallest n with P(N > n) <= p for N ~ Poisson(mean): the upper tail in double precision, summed
/// from its far end so that small probabilities keep their digits. mean <= kShotSmall, p < 2^-10.
MALUS_HOST_DEVICE inline float shot_upper_tail(float mean, std::uint32_t word) {
  const double p = (static_cast<double>(word & 0x7FFFFFFFu) + 0.5) * 0x1p-32;
  const double m = static_cast<double>(mean);
  constexpr int kFar = 60;
  constexpr double kLeast = 1e-300;  // below, double precision loses digits, then everything
  double probability = exp(-m), beyond = 0.0;  // of k, and of all from k on
  int far = 0;
  while (far < kFar && probability * m > kLeast * (far + 1)) probability *= m / ++far;
  for (int k = far; k > 0; --k) {
    beyond += probability;
    if (beyond > p) return static_cast<float>(k);
    probability *= k / m;
  }
  return 0.0f;
}

}  // namespace malus
