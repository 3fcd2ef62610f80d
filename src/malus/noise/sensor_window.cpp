#include "malus/noise/sensor_window.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/image/window.h"

#include <algorithm>
#include <memory>
#include <numeric>
#include <vector>

#include <fmt/format.h>

namespace malus {
namespace {

struct Size {
  int rows = 0, cols = 0;  ///< 0: not known
};

// contradiction_in(model) sees to it that all maps have one size.
Size sensor_size(const NoiseProfile& profile) {
  if (profile.defects.rows > 0) return {profile.defects.rows, profile.defects.cols};
  if (profile.pattern)
    for (const Image* map : {&profile.pattern->dark_dn, &profile.pattern->response})
      if (!map->empty()) return {map->rows(), map->cols()};
  return {};
}

// Then it is no part of the sensor, wherever it is said to lie.
bool is_larger(int rows, int cols, Size sensor) {
  return sensor.rows > 0 && (rows > sensor.rows || cols > sensor.cols);
}

std::string larger_words(int rows, int cols, Size sensor) {
  return fmt::format("{} x {} pixels are more than the model's sensor has, {} x {}", cols, rows,
                     sensor.cols, sensor.rows);
}

constexpr const char* kOfThisSensor =
    "use the model of this sensor, in the same orientation and binning";

std::string places_left_out(const NoiseProfile& profile) {
  const std::ptrdiff_t defects = std::ssize(profile.defects.places);
  if (!profile.pattern) return counted_are(defects, "defect pixel") + " left out";
  if (defects == 0) return "maps of the fixed pattern are left out";
  return counted(defects, "defect pixel") + " and maps of the fixed pattern are left out";
}

Image window_of_map(const Image& map, SensorPlace origin, int rows, int cols) {
  return map.empty() ? Image() : part_of(map, {origin.row, origin.col, rows, cols});
}

void check_window(const NoiseProfile& profile, Size sensor, SensorPlace origin, int rows, int cols,
                  const std::string& source) {
  if (is_larger(rows, cols, sensor))
    throw InputError(source, larger_words(rows, cols, sensor), kOfThisSensor);
  require_whole_cells(origin, profile.layout, profile.row_group, source);
  if (sensor.rows > 0 && (rows > sensor.rows - origin.row || cols > sensor.cols - origin.col))
    throw InputError(source,
                     fmt::format("{} x {} pixels from row {}, column {} on reach beyond the "
                                 "model's sensor of {} x {}",
                                 cols, rows, origin.row, origin.col, sensor.cols, sensor.rows),
                     "correct " + setting("origin") + ", or use this sensor's model");
}

}  // namespace

void require_whole_cells(SensorPlace origin, const SensorLayout& layout, int row_group,
                         const std::string& source) {
  const int row_step = std::lcm(layout.rows(), row_group), col_step = layout.cols();
  if (origin.row < 0 || origin.col < 0)
    throw InputError(
        source, fmt::format("row {}, column {} is no place on a sensor", origin.row, origin.col),
        "correct " + setting("origin"));
  if (origin.row % row_step != 0 || origin.col % col_step != 0)
    throw InputError(source,
                     fmt::format("row {}, column {} of the sensor, where it begins, is not a "
                                 "multiple of {} rows and {} columns, the cell and row group of {}",
                                 origin.row, origin.col, row_step, col_step, layout.name()),
                     "cut frames at whole cells, or correct " + setting("origin"));
}

void cut_to_window(NoiseProfile& profile, SensorPlace origin, int rows, int cols,
                   const std::string& source) {
  const Size sensor = sensor_size(profile);
  check_window(profile, sensor, origin, rows, cols, source);
  if (sensor.rows == 0) return;
  DefectList inside{rows, cols, {}};
  for (const DefectList::Place& p : profile.defects.places)
    if (p.row >= origin.row && p.row - origin.row < rows && p.col >= origin.col &&
        p.col - origin.col < cols)
      inside.places.push_back({p.row - origin.row, p.col - origin.col});
  profile.defects = std::move(inside);
  if (!profile.pattern) return;
  const FixedPattern& whole = *profile.pattern;
  const auto columns_of = [&](const Image& map) {
    return window_of_map(map, {0, origin.col}, map.rows(), cols);
  };
  FixedPattern pattern{window_of_map(whole.dark_dn, origin, rows, cols),
                       window_of_map(whole.response, origin, rows, cols),
                       columns_of(whole.dark_columns_dn),
                       columns_of(whole.response_columns),
                       whole.dark_kept,
                       whole.response_kept,
                       whole.dark_columns_kept,
                       whole.response_columns_kept};
  profile.pattern = std::make_shared<const FixedPattern>(std::move(pattern));
}

std::string left_out_of_window(const NoiseProfile& profile, int rows, int cols) {
  const Size sensor = sensor_size(profile);
  if (sensor.rows == 0 || (sensor.rows == rows && sensor.cols == cols)) return {};
  if (profile.defects.places.empty() && !profile.pattern) return {};
  if (is_larger(rows, cols, sensor))
    return fmt::format("{}: its {}; {}", larger_words(rows, cols, sensor), places_left_out(profile),
                       kOfThisSensor);
  return fmt::format(
      "{} x {} pixels of a sensor of {} x {}: the model's {}; say where the frame lies on the "
      "sensor with {} (row, column)",
      cols, rows, sensor.cols, sensor.rows, places_left_out(profile), setting("origin"));
}

std::string fit_to_sensor(NoiseProfile& profile, const RawFrame& frame,
                          std::optional<SensorPlace> origin, bool fill_defects) {
  if (!fill_defects) profile.defects.places.clear();
  const int rows = frame.dn.rows(), cols = frame.dn.cols();
  if (!origin) return left_out_of_window(profile, rows, cols);
  cut_to_window(profile, *origin, rows, cols, frame.source);
  return {};
}

}  // namespace malus
