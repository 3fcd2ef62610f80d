#include "malus/noise/fixed_pattern.h"

#include "malus/base/error.h"
#include "malus/noise/model.h"

#include <cmath>
#include <limits>

namespace malus {
namespace {

double distance_db(const GainSetting& a, const GainSetting& b) {
  const auto x = a.decibel(), y = b.decibel();
  return x && y ? std::abs(*x - *y) : std::numeric_limits<double>::infinity();
}

// A copy in which defects, which are told by their place, count as ordinary pixels.
Image nearest_map(const NoiseModel& model, const GainSetting& gain, Image PhysicsCalibration::*map,
                  float ordinary) {
  const PhysicsCalibration* nearest = nullptr;
  for (const PhysicsCalibration& p : model.physics)
    if (!(p.*map).empty() &&
        (!nearest || distance_db(p.gain, gain) < distance_db(nearest->gain, gain)))
      nearest = &p;
  if (!nearest) return {};
  Image copy = nearest->*map;
  for (const DefectPixel& defect : model.defects) {
    MALUS_REQUIRE(defect.row < copy.rows() && defect.col < copy.cols());  // see contradiction_in
    copy(defect.row, defect.col) = ordinary;
  }
  return copy;
}

}  // namespace

std::shared_ptr<const FixedPattern> fixed_pattern_at(const NoiseModel& model,
                                                     const GainSetting& gain) {
  FixedPattern pattern{nearest_map(model, gain, &PhysicsCalibration::dark_shading_dn, 0),
                       nearest_map(model, gain, &PhysicsCalibration::prnu_map, 1)};
  if (pattern.dark_dn.empty() && pattern.response.empty()) return nullptr;
  return std::make_shared<const FixedPattern>(std::move(pattern));
}

double map_values(const NoiseModel& model) {
  double values = 0;
  for (const PhysicsCalibration& p : model.physics)
    values += static_cast<double>(p.dark_shading_dn.size() + p.prnu_map.size());
  return values;
}

void drop_maps(NoiseModel& model) {
  for (PhysicsCalibration& p : model.physics) p.dark_shading_dn = p.prnu_map = Image();
}

}  // namespace malus
