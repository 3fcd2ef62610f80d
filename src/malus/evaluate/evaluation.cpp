#include "malus/evaluate/evaluation.h"

#include "malus/base/parallel.h"
#include "malus/evaluate/image_metrics.h"
#include "malus/evaluate/polarization_metrics.h"
#include "malus/image/pack.h"
#include "malus/polar/stokes.h"

#include <algorithm>
#include <utility>

namespace malus {
namespace {

const Undecided kNoAngles{"the layout has no polarizers"};

void append(std::vector<Quantity>& list, const Estimate<double>& value, Quantity quantity) {
  if (!value) return;
  quantity.value = {*value};
  list.push_back(std::move(quantity));
}

// Packing fills a cell that the edge cuts with samples of the cell before, which would then count
// several times.
View<const float> whole_cells(View<const float> mosaic, const SensorLayout& layout) {
  return mosaic.window(0, 0, mosaic.rows() / layout.rows() * layout.rows(),
                       mosaic.cols() / layout.cols() * layout.cols());
}

// Of large frames neither all planes nor what is made of them are held beside the mosaics.
Estimate<double> ssim_of_mosaics(View<const float> reference, View<const float> test,
                                 const SensorLayout& layout, double peak_dn) {
  if (layout.channels() == 1) return ssim(reference, test, peak_dn);
  double sum = 0;
  for (int k = 0; k < layout.channels(); ++k) {
    const Estimate<double> value = ssim(pack_channel(reference, layout, k).view(),
                                        pack_channel(test, layout, k).view(), peak_dn);
    if (!value) return value;
    sum += *value;
  }
  return sum / layout.channels();
}

PolarizationError polarization_error_of_mosaics(View<const float> reference, View<const float> test,
                                                const SensorLayout& layout) {
  const int band = 2 * kRowsPerTask * layout.rows();
  const auto stokes = [&](View<const float> mosaic, int row0) {
    const int rows = std::min(band, mosaic.rows() - row0);
    return stokes_per_color(pack(mosaic.window(row0, 0, rows, mosaic.cols()), layout), layout);
  };
  PolarizationError error;
  for (int row0 = 0; row0 < reference.rows(); row0 += band)
    error = sum_of(error, polarization_error(stokes(reference, row0), stokes(test, row0)));
  return error;
}

}  // namespace

Evaluation evaluate_planes(const Planes& reference, const Planes& test, double peak_dn) {
  Evaluation result{psnr_db(reference, test, peak_dn), ssim(reference, test, peak_dn), kNoAngles,
                    kNoAngles, kNoAngles};
  for (int k = 0; k < reference.channels(); ++k)
    result.pixels_left_out +=
        static_cast<std::int64_t>(reference[k].size()) - squared_error(reference[k], test[k]).count;
  return result;
}

Evaluation evaluate_mosaics(View<const float> reference, View<const float> test,
                            const SensorLayout& layout, double peak_dn) {
  MALUS_REQUIRE(reference.rows() == test.rows() && reference.cols() == test.cols());
  const SquaredError squared = squared_error(reference, test);
  const View<const float> a = whole_cells(reference, layout), b = whole_cells(test, layout);
  Evaluation result{psnr_db(squared, peak_dn), ssim_of_mosaics(a, b, layout, peak_dn), kNoAngles,
                    kNoAngles, kNoAngles};
  result.pixels_left_out = std::int64_t{reference.rows()} * reference.cols() - squared.count;
  if (!layout.polarized()) return result;
  const PolarizationError error = polarization_error_of_mosaics(a, b, layout);
  result.dolp_psnr_db = dolp_psnr_db(error);
  result.aolp_psnr_db = aolp_psnr_db(error);
  result.aolp_circular_deg = aolp_circular_deg(error);
  return result;
}

std::vector<Quantity> quantities_of(const Evaluation& e) {
  std::vector<Quantity> list;
  append(list, e.image_psnr_db,
         {"image_psnr", "PSNR", "dB", "peak signal-to-noise ratio over all channels", {}});
  append(list, e.image_ssim,
         {"image_ssim", "SSIM", "1", "structural similarity, mean over the channels", {}});
  append(list, e.dolp_psnr_db, {"dolp_psnr", "PSNR(DoLP)", "dB", "PSNR of DoLP, peak 1", {}});
  append(list, e.aolp_psnr_db,
         {"aolp_psnr", "PSNR(AoLP)", "dB", "PSNR of the linear difference of AoLP/180°", {}});
  append(list, e.aolp_circular_deg,
         {"aolp_circular", "RMS(AoLP)", "deg", "circular RMS error of AoLP, weighted by DoLP", {}});
  return list;
}

}  // namespace malus
