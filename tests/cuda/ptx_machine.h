// What ptx_to_cpp.py's C++ needs: PTX instructions that are no C++ operators, and memory.
#pragma once

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <limits>

#include "ptx_place.h"

namespace malus::testing::ptx {

template <class T>
void load(T& value, const unsigned char* from) {
  std::memcpy(&value, from, sizeof(T));
}

template <class T>
void store(T value, unsigned char* to) {
  std::memcpy(to, &value, sizeof(T));
}

inline unsigned char* pointer(std::uint64_t address) {
  return reinterpret_cast<unsigned char*>(address);
}

inline std::uint64_t address(const unsigned char* symbol) {
  return reinterpret_cast<std::uint64_t>(symbol);
}

template <class T>
void unpack(T value, std::uint32_t& low, std::uint32_t& high) {
  const auto bits = std::bit_cast<std::uint64_t>(value);
  low = static_cast<std::uint32_t>(bits);
  high = static_cast<std::uint32_t>(bits >> 32);
}

template <class T>
void pack(std::uint32_t low, std::uint32_t high, T& value) {
  value = std::bit_cast<T>(std::uint64_t{high} << 32 | low);
}

// Shifts by the width or more leave nothing, or the sign.
template <class T>
T shr(T value, std::uint32_t by) {
  constexpr std::uint32_t kBits = 8 * sizeof(T);
  if (by >= kBits) return value < 0 ? static_cast<T>(-1) : static_cast<T>(0);
  return static_cast<T>(value >> by);
}

template <class T>
T shl(T value, std::uint32_t by) {
  return by >= 8 * sizeof(T) ? static_cast<T>(0) : static_cast<T>(value << by);
}

/// Towards zero, at the type's limits where the value is beyond them; 0 for NaN.
template <class Integer, class Real>
Integer truncated(Real value) {
  using Limits = std::numeric_limits<Integer>;
  if (std::isnan(value)) return 0;
  if (value <= static_cast<Real>(Limits::min())) return Limits::min();
  if (value >= static_cast<Real>(Limits::max())) return Limits::max();
  return static_cast<Integer>(value);
}

template <class Real>
Real rcp(Real value) {
  return Real{1} / value;
}

// A device's approximations have errors of their own, which a CPU does not know. So these are off
// too, up to what PTX says of the device's, the one argument by something else than the next: no
// pixel may hang on their last bits.
inline float error_of(float value) {
  const std::uint32_t mixed = std::bit_cast<std::uint32_t>(value) * 2654435769u;
  return static_cast<float>(static_cast<int>(mixed >> 29) - 3) / 4.0f;  // -3/4, -1/2, ... 1
}

/// rcp.approx.ftz.f32: within one unit in the last place; nothing subnormal.
inline float rcp_approx(float value) {
  const float exact = 1.0f / value, error = error_of(value);
  if (!std::isnormal(exact)) return std::isfinite(exact) ? std::copysign(0.0f, exact) : exact;
  if (error > -0.5f && error < 0.5f) return exact;
  return std::nextafter(exact, error < 0 ? 0.0f : std::numeric_limits<float>::infinity());
}

/// rsqrt.approx.ftz.f32: relative error up to 2^-22.9.
inline float rsqrt_approx(float value) {
  const double relative = 1.2e-7 * static_cast<double>(error_of(value));  // 2^-22.99 at most
  return static_cast<float>((1.0 + relative) / std::sqrt(static_cast<double>(value)));
}

/// The low `count` bits of `bits` put into `into` from bit `first` on.
inline std::uint32_t bfi(std::uint32_t bits, std::uint32_t into, std::uint32_t first,
                         std::uint32_t count) {
  const std::uint32_t mask = shl(shl(1u, count) - 1u, first);
  return (into & ~mask) | (shl(bits, first) & mask);
}

}  // namespace malus::testing::ptx
