// Images per second that a network filters and learns from on a device. Names no libtorch type.
#pragma once

#include "malus/neural/measure.h"

#include <string>
#include <vector>

namespace malus {

/// What is measured: forward passes, and training steps (forward, L1, backward, Adam).
struct DeviceWork {
  std::string device = "cuda";
  int channels = 16;
  int inference_batch = 8, inference_side = 256;
  int training_batch = 16, training_side = 128;
  bool once = false;  ///< a dry run: one step each
};

struct DeviceSpeed {
  std::string work;            ///< "inference" or "training"
  std::string precision;       ///< "float32" or "bfloat16" (autocast)
  double images_per_s = 0;     ///< median; 0: the device's memory did not suffice
  bool channels_last = false;  ///< the order of memory that malus takes
  double other_order_images_per_s = 0;
  /// Whether float32 is rounded to TF32's 11 bits in convolutions and in matrix products.
  bool tf32_convolutions = false, tf32_products = false;
};

/// Inference and training in float32, and in bfloat16 where that is offered (unet, nafnet). Random
/// planes and weights; the planes lie on the device. Throws InputError where the device is not
/// there.
std::vector<DeviceSpeed> measure_device_speed(const NamedNetwork& network, const DeviceWork& work);

}  // namespace malus
