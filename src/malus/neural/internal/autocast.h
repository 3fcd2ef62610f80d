// bfloat16 layers for a while, where that is right.
#pragma once

#include <string_view>

#include <ATen/autocast_mode.h>
#include <torch/torch.h>
#include <torch/version.h>

namespace malus {

#if TORCH_VERSION_MAJOR > 2 || (TORCH_VERSION_MAJOR == 2 && TORCH_VERSION_MINOR >= 4)
#define MALUS_AUTOCAST_BY_DEVICE
#endif

inline bool cpu_layers_are_rounded() {
#if defined(MALUS_AUTOCAST_BY_DEVICE)
  return at::autocast::is_autocast_enabled(at::kCPU);
#else
  return at::autocast::is_cpu_enabled();
#endif
}

/// Whether an architecture's layers may be rounded by Autocast: those made of convolutions. The
/// attention of the others is wrong or fails under it (docs/networks.md).
inline bool autocast_suits(std::string_view architecture) {
  return architecture == "unet" || architecture == "nafnet";
}

/// Layers in bfloat16 while it lives. Only for architectures that it suits.
class Autocast {
 public:
  Autocast(bool wanted, bool cuda) : wanted_(wanted), cuda_(cuda) { set(wanted); }
  ~Autocast() {
    set(false);
    if (wanted_) at::autocast::clear_cache();
  }
  Autocast(const Autocast&) = delete;
  Autocast& operator=(const Autocast&) = delete;

 private:
  void set(bool on) const {
    if (!wanted_) return;
#if defined(MALUS_AUTOCAST_BY_DEVICE)
    const auto device = cuda_ ? at::kCUDA : at::kCPU;
    at::autocast::set_autocast_dtype(device, torch::kBFloat16);
    at::autocast::set_autocast_enabled(device, on);
#else
    if (cuda_) {
      at::autocast::set_autocast_gpu_dtype(torch::kBFloat16);
      at::autocast::set_enabled(on);
    } else {
      at::autocast::set_autocast_cpu_dtype(torch::kBFloat16);
      at::autocast::set_cpu_enabled(on);
    }
#endif
  }
  bool wanted_, cuda_;
};

}  // namespace malus
