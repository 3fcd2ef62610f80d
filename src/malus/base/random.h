// Counter-based random numbers: every draw is a pure function of (seed, frame, pixel, draw), so
// results do not depend on threads, tiles or order. Philox4x32-10: Salmon, Moraes, Dror, Shaw,
// "Parallel random numbers: as easy as 1, 2, 3", SC 2011, section 3.3; checked against the
// known-answer vectors of that paper's Random123 distribution.
#pragma once

#include "malus/base/host_device.h"

#include <cstdint>

namespace malus {

struct PhiloxBlock {
  std::uint32_t word[4];
};

/// The ten rounds' keys of one 64-bit key.
struct PhiloxKeys {
  std::uint32_t round[10][2];
};

MALUS_HOST_DEVICE inline PhiloxKeys philox_keys(std::uint64_t key) {
  constexpr std::uint32_t kWeyl0 = 0x9E3779B9u, kWeyl1 = 0xBB67AE85u;
  PhiloxKeys keys{};
  auto key0 = static_cast<std::uint32_t>(key), key1 = static_cast<std::uint32_t>(key >> 32);
  for (auto& round : keys.round) {
    round[0] = key0;
    round[1] = key1;
    key0 += kWeyl0;
    key1 += kWeyl1;
  }
  return keys;
}

MALUS_HOST_DEVICE inline std::uint64_t wide_product(std::uint32_t a, std::uint32_t b) {
#if defined(__CUDA_ARCH__)
  // nvcc makes a 64-bit product of the plain expression, an addition more.
  std::uint64_t product;
  asm("mul.wide.u32 %0, %1, %2;" : "=l"(product) : "r"(a), "r"(b));
  return product;
#else
  return std::uint64_t{a} * b;
#endif
}

/// One block of four independent uniform 32-bit words for a 128-bit counter and a 64-bit key.
MALUS_HOST_DEVICE inline PhiloxBlock philox4x32(const PhiloxBlock& counter,
                                                const PhiloxKeys& keys) {
  constexpr std::uint32_t kMultiplier0 = 0xD2511F53u, kMultiplier1 = 0xCD9E8D57u;
  PhiloxBlock x = counter;
  for (int round = 0; round < 10; ++round) {
    const std::uint64_t product0 = wide_product(x.word[0], kMultiplier0);
    const std::uint64_t product1 = wide_product(x.word[2], kMultiplier1);
    x = PhiloxBlock{{static_cast<std::uint32_t>(product1 >> 32) ^ x.word[1] ^ keys.round[round][0],
                     static_cast<std::uint32_t>(product1),
                     static_cast<std::uint32_t>(product0 >> 32) ^ x.word[3] ^ keys.round[round][1],
                     static_cast<std::uint32_t>(product0)}};
  }
  return x;
}

MALUS_HOST_DEVICE inline PhiloxBlock philox4x32(const PhiloxBlock& counter, std::uint64_t key) {
  return philox4x32(counter, philox_keys(key));
}

/// What a draw is for: streams never collide because the purpose is part of the counter.
enum class Draw : std::uint32_t {
  kPixel = 0,       ///< per pixel of a frame
  kRow = 1,         ///< per row group of a frame
  kParameters = 2,  ///< per frame: gains, biases, sampled model parameters
  kScene = 3,       ///< clean material: crops, textures, polarization
  kDither = 4,      ///< per pixel of a frame: what goes before a rounding
  kOther = 64,      ///< alone under its seed: the choices of a training, benchmarks, tests
  kFlowCrop = 65,   ///< per step of a flow's training: its piece of a frame
  kFlow = 66,       ///< per pixel of a frame, of a noise flow
  kUser = 128,      ///< first of the caller's own; up to 255
};

/// Four words for (seed, frame, index, purpose, sub-draw). index is the pixel's (or row group's)
/// number in the whole frame, never in the tile. frame < 2^32, sub < 2^24. Seed: the number, or
/// its philox_keys.
template <class Seed>
MALUS_HOST_DEVICE inline PhiloxBlock random_block(const Seed& seed, std::uint32_t frame,
                                                  std::uint64_t index, Draw purpose,
                                                  std::uint32_t sub = 0) {
  return philox4x32(
      PhiloxBlock{{static_cast<std::uint32_t>(index), static_cast<std::uint32_t>(index >> 32),
                   frame, (static_cast<std::uint32_t>(purpose) << 24) | sub}},
      seed);
}

/// random_block's index of a pixel of the whole frame.
MALUS_HOST_DEVICE inline std::uint64_t pixel_index(int row, int col) {
  return std::uint64_t{static_cast<std::uint32_t>(row)} << 32 | static_cast<std::uint32_t>(col);
}

/// Uniform on (0,1), never 0 or 1, from one word; the lattice is the centres of 2^32 equal cells.
MALUS_HOST_DEVICE inline double uniform_open(std::uint32_t word) {
  return (static_cast<double>(word) + 0.5) * 0x1p-32;
}

/// Uniform on (0,1), never 0 or 1, from two words: 52 bits, so that adding a half is exact.
MALUS_HOST_DEVICE inline double uniform_open(std::uint32_t high, std::uint32_t low) {
  const std::uint64_t bits = (std::uint64_t{high} << 32 | low) >> 12;
  return (static_cast<double>(bits) + 0.5) * 0x1p-52;
}

/// Standard normal deviate with the given upper-tail-safe uniform: quantile function, |relative
/// error| < 1e-15 (Wichura, Algorithm AS 241, 1988).
double normal_quantile(double u);

/// A sequence of draws for one purpose: for per-frame parameters and scenes, where speed does not
/// matter. Satisfies UniformRandomBitGenerator.
class RandomSequence {
 public:
  using result_type = std::uint32_t;
  RandomSequence(std::uint64_t seed, std::uint32_t frame, Draw purpose, std::uint64_t index = 0)
      : seed_(seed), index_(index), frame_(frame), purpose_(purpose) {}
  static constexpr result_type min() { return 0; }
  static constexpr result_type max() { return 0xFFFFFFFFu; }
  result_type operator()() {
    if (used_ == 4) {
      block_ = random_block(seed_, frame_, index_, purpose_, sub_++);
      used_ = 0;
    }
    return block_.word[used_++];
  }
  double uniform() {
    const auto high = (*this)();
    return uniform_open(high, (*this)());
  }
  double normal() { return normal_quantile(uniform()); }

 private:
  std::uint64_t seed_, index_;
  std::uint32_t frame_;
  Draw purpose_;
  std::uint32_t sub_ = 0;
  int used_ = 4;
  PhiloxBlock block_{};
};

}  // namespace malus
