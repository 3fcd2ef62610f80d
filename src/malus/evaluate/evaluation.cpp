#include "malus/evaluate/evaluation.h"

#include "malus/evaluate/image_metrics.h"
#include "malus/evaluate/polarization_metrics.h"
#include "malus/image/pack.h"
#include "malus/polar/stokes.h"

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
Planes packed_whole_cells(View<const float> mosaic, const SensorLayout& layout) {
  const int rows = mosaic.rows() / layout.rows() * layout.rows();
  const int cols = mosaic.cols() / layout.cols() * layout.cols();
  return pack(mosaic.window(0, 0, rows, cols), layout);
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
  Planes a = packed_whole_cells(reference, layout), b = packed_whole_cells(test, layout);
  Evaluation result{psnr_db(squared, peak_dn), ssim(a, b, peak_dn), kNoAngles, kNoAngles,
                    kNoAngles};
  result.pixels_left_out = std::int64_t{reference.rows()} * reference.cols() - squared.count;
  if (!layout.polarized()) return result;
  // Of large frames the planes are not held beside what is made of them.
  const auto reference_stokes = stokes_per_color(std::exchange(a, {}), layout);
  const auto test_stokes = stokes_per_color(std::exchange(b, {}), layout);
  const PolarizationError error = polarization_error(reference_stokes, test_stokes);
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
