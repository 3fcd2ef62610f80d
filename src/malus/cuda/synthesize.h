// The compiled sampler on the GPU: the lines of synthesize/formation-inl.h, the same random words,
// the same bits as on the CPU.
#pragma once

#include "malus/synthesize/compiled.h"

#include <memory>

namespace malus::cuda {

/// A model's tables on the device; one thread at a time. Throws InputError where no device answers
/// (device.h).
class DeviceNoise {
 public:
  explicit DeviceNoise(const CompiledNoise& noise);
  ~DeviceNoise();
  DeviceNoise(DeviceNoise&&) noexcept;
  DeviceNoise& operator=(DeviceNoise&&) noexcept;

  /// Device pointers, DN above black; strides in elements; in place if wanted. Asynchronous on the
  /// default stream: of two calls the second prepares its frame while the device draws the first's.
  void apply_on_device(const float* clean_dn, std::ptrdiff_t clean_stride, float* noisy_dn,
                       std::ptrdiff_t noisy_stride, int rows, int cols,
                       const DrawAddress& address) const;
  /// Host views: copies to the device and back; waits.
  void apply(View<const float> clean_dn, View<float> noisy_dn, const DrawAddress& address) const;

 private:
  struct Tables;
  std::unique_ptr<Tables> tables_;
};

/// Pixels per second of a frame in the device's memory: noise drawn, and the same frame copied.
/// Eight in a row are timed, so that the host draws the rows of the next frame while the device
/// draws: as when frames follow one another. Its signals are spread from 0 to top_dn in no order.
/// Throws InputError as DeviceNoise does.
struct DeviceRates {
  double drawn = 0, copied = 0;
};
DeviceRates measure_rates(const CompiledNoise& noise, int rows, int cols, double top_dn);

}  // namespace malus::cuda
