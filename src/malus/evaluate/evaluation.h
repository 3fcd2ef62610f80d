// One picture against its reference: the metrics of 000 Table 1 as quantities.
#pragma once

#include "malus/base/estimate.h"
#include "malus/base/quantity.h"
#include "malus/image/layout.h"
#include "malus/image/view.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace malus {

struct Evaluation {
  Estimate<double> image_psnr_db, image_ssim;
  Estimate<double> dolp_psnr_db, aolp_psnr_db, aolp_circular_deg;  ///< undecided without angles
  std::int64_t pixels_left_out = 0;  ///< not finite in one of the pictures
};

/// Mean of one metric over the frames that have it: unpolarized light has no error of AoLP.
class MeanOfDecided {
 public:
  void add(const Estimate<double>& value) {
    if (!value) return;
    sum_ += *value;
    ++count_;
  }
  /// None where no frame has the metric.
  std::optional<double> mean() const {
    return count_ > 0 ? std::optional(sum_ / static_cast<double>(count_)) : std::nullopt;
  }

 private:
  double sum_ = 0;
  std::int64_t count_ = 0;
};

/// Planes in DN above black, same channels and sizes; peak_dn is white above black. PSNR and SSIM
/// over all channels in units of peak, nothing clipped.
Evaluation evaluate_planes(const Planes& reference, const Planes& test, double peak_dn);

/// Two mosaics in DN above black of one layout and size. PSNR counts every pixel once. SSIM on the
/// packed planes; with a polarized layout also DoLP and AoLP of every colour at one per cell: these
/// from whole cells, without the rows and columns of a cell that the last edges cut.
Evaluation evaluate_mosaics(View<const float> reference, View<const float> test,
                            const SensorLayout& layout, double peak_dn);

/// The decided ones, named image_psnr, image_ssim, dolp_psnr, aolp_psnr, aolp_circular.
std::vector<Quantity> quantities_of(const Evaluation& evaluation);

}  // namespace malus
