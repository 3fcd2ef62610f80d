#include "malus/base/error.h"
#include "malus/image/pack.h"
#include "malus/image/window.h"
#include "malus/report/internal/json.h"
#include "malus/report/internal/raster.h"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

namespace malus::internal {
namespace {

// Parts of the noise's standard deviation between stored values, finest first. They add step²/12 to
// the noise's variance: half a deviation 2 %, one 8 %, the coarsest 13 %.
constexpr std::array kSteps = {0.125, 0.25, 0.5, 0.75, 1.0, 1.25};
constexpr double kBase64 = 4.0 / 3.0;
constexpr int kCropSide = 512, kSmallestCrop = 32;  // mosaic pixels, rounded up to whole cells
constexpr double kCropShare = 0.15;

bool integers_only(const Image& image) {
  return std::all_of(image.values().begin(), image.values().end(), [](float value) {
    return !std::isfinite(value) || std::abs(value - std::round(value)) < 1e-4F;
  });
}

// A band of every few rows of each plane: enough to tell the size of the whole within a few per
// cent.
Planes sample_rows(const Planes& planes) {
  constexpr int kBand = 16, kEvery = 8;
  if (planes.rows() < 2 * kBand * kEvery) return planes;
  const int bands = planes.rows() / (kBand * kEvery);
  Planes sample(planes.channels(), bands * kBand, planes.cols());
  for (int channel = 0; channel < planes.channels(); ++channel)
    for (int r = 0; r < sample.rows(); ++r)
      std::copy_n(planes[channel].row(r / kBand * kBand * kEvery + r % kBand), planes.cols(),
                  sample[channel].row(r));
  return sample;
}

double encoded_size(const Planes& planes, const std::vector<RasterScale>& scales, bool dithered) {
  const Planes sample = sample_rows(planes);
  return kBase64 * static_cast<double>(encode_raster(sample, scales, dithered).size()) *
         static_cast<double>(planes.rows()) / static_cast<double>(std::max(sample.rows(), 1));
}

struct Packed {
  Planes planes;
  bool integers = false;
};

// One packing of a block: what is left to choose is how fine the steps are.
struct Plan {
  std::vector<Packed> pictures;
  std::vector<std::vector<Image>> maps;  // per layer, per picture
  int rows = 0, cols = 0;
  int binning = 1;
};

NoiseLine noise_of(const PicturesBlock& block, int channel) {
  // Unknown noise: one part in 4096 of the range stands in for a standard deviation.
  const double unknown = block.white_dn / 4096;
  if (block.noise.empty()) return {0, unknown * unknown};
  NoiseLine line = block.noise[static_cast<std::size_t>(channel)];
  line.slope_dn = std::max(line.slope_dn, 0.0);
  line.offset_dn2 = std::max(line.offset_dn2, 1e-6 * unknown * unknown);
  return line;
}

// Exact steps of 1 DN win where they are no finer than the part of the noise asked for.
std::vector<RasterScale> scales_of(const PicturesBlock& block, std::size_t picture,
                                   const Packed& packed, double part, bool& exact) {
  const double step = part * block.pictures[picture].noise_part;
  std::vector<RasterScale> scales;
  exact = packed.integers;
  for (int channel = 0; channel < packed.planes.channels(); ++channel) {
    const NoiseLine line = noise_of(block, channel);
    scales.push_back({line.slope_dn, line.offset_dn2, step});
    exact = exact && step * std::sqrt(line.offset_dn2) <= 1;
  }
  if (exact) std::fill(scales.begin(), scales.end(), RasterScale{});
  return scales;
}

Image binned(const Image& image, int factor) {
  Image small((image.rows() + factor - 1) / factor, (image.cols() + factor - 1) / factor);
  for (int r = 0; r < small.rows(); ++r)
    for (int c = 0; c < small.cols(); ++c) {
      double sum = 0;
      int count = 0;
      for (int y = r * factor; y < std::min((r + 1) * factor, image.rows()); ++y)
        for (int x = c * factor; x < std::min((c + 1) * factor, image.cols()); ++x) {
          sum += static_cast<double>(image(y, x));
          ++count;
        }
      small(r, c) = static_cast<float>(sum / count);
    }
  return small;
}

Plan make_plan(const PicturesBlock& block, int binning) {
  Plan plan{.pictures = {}, .maps = {}, .rows = block.rows, .cols = block.cols, .binning = binning};
  if (binning > 1) {
    const auto shrunk = [&](int size, int cell) {
      return packed_size(packed_size(size, cell), binning) * cell;
    };
    plan.rows = shrunk(block.rows, block.layout.rows());
    plan.cols = shrunk(block.cols, block.layout.cols());
  }
  for (const ReportPicture& picture : block.pictures) {
    MALUS_REQUIRE(picture.dn.rows() == block.rows && picture.dn.cols() == block.cols);
    Packed packed{pack(picture.dn, block.layout), binning == 1 && integers_only(picture.dn)};
    if (binning > 1)
      for (Image& plane : packed.planes) plane = binned(plane, binning);
    plan.pictures.push_back(std::move(packed));
  }
  for (const Layer& layer : block.layers) {
    auto& maps = plan.maps.emplace_back();
    for (const Image& map : layer.maps)
      maps.push_back(binning > 1 && !map.empty() ? binned(map, binning) : map);
  }
  return plan;
}

RasterScale layer_scale(const Layer& layer) {
  constexpr double kLevels = 250;  // as many as the palette shows
  return {0, 1, std::max((layer.high - layer.low) / kLevels, 1e-12)};
}

Json raster_json(const Planes& planes, const std::vector<RasterScale>& scales, bool dithered,
                 std::vector<Blob>& blobs) {
  Json list = Json::array();
  for (const auto& [slope, offset, step] : scales)
    list.push_back({{"slope", slope}, {"offset", offset}, {"step", step}});
  blobs.push_back({fmt::format("raster-{}", blobs.size() + 1),
                   base64(encode_raster(planes, scales, dithered))});
  return {{"blob", blobs.back().id},
          {"rows", planes.rows()},
          {"cols", planes.cols()},
          {"scales", list},
          {"dithered", dithered}};
}

Json layer_json(const Layer& layer, const std::vector<Image>& maps, std::vector<Blob>& blobs) {
  Json rasters = Json::array();
  for (const Image& map : maps) {
    if (map.empty()) {
      rasters.push_back(nullptr);
      continue;
    }
    Planes single(1, 0, 0);
    single[0] = map;
    rasters.push_back(raster_json(single, {layer_scale(layer)}, true, blobs));
  }
  return {{"name", layer.name}, {"unit", layer.unit},
          {"text", layer.text}, {"palette", palette_name(layer.palette)},
          {"low", layer.low},   {"high", layer.high},
          {"rasters", rasters}};
}

Json cell_json(const SensorLayout& layout) {
  Json sites = Json::array();
  for (int channel = 0; channel < layout.channels(); ++channel) {
    const Site& site = layout.site(channel);
    sites.push_back({{"name", layout.channel_name(channel)},
                     {"color", color_name(site.color)},
                     {"angle", site.angle_deg ? Json(*site.angle_deg) : Json()}});
  }
  return {{"rows", layout.rows()}, {"cols", layout.cols()}, {"sites", sites}};
}

double maps_size(const PicturesBlock& block, const Plan& plan) {
  double size = 0;
  for (std::size_t layer = 0; layer < plan.maps.size(); ++layer)
    for (const Image& map : plan.maps[layer]) {
      Planes single(1, 0, 0);
      single[0] = map;
      if (!map.empty()) size += encoded_size(single, {layer_scale(block.layers[layer])}, true);
    }
  return size;
}

// The finest step whose pictures fit; 0 when none does.
double step_that_fits(const PicturesBlock& block, const Plan& plan, double budget) {
  const double maps = maps_size(block, plan);
  for (const double part : kSteps) {
    double size = maps;
    bool exact = false;
    for (std::size_t p = 0; p < plan.pictures.size(); ++p) {
      const auto scales = scales_of(block, p, plan.pictures[p], part, exact);
      size += encoded_size(plan.pictures[p].planes, scales, !exact);
    }
    if (size <= budget) return part;
    if (plan.pictures.empty()) break;  // maps have steps of their own
  }
  return 0;
}

Json block_json(const PicturesBlock& block, const Plan& plan, double part,
                std::vector<Blob>& blobs) {
  Json pictures = Json::array(), layers = Json::array();
  for (std::size_t p = 0; p < plan.pictures.size(); ++p) {
    bool exact = false;
    const auto scales = scales_of(block, p, plan.pictures[p], part, exact);
    pictures.push_back({{"name", block.pictures[p].name},
                        {"raster", raster_json(plan.pictures[p].planes, scales, !exact, blobs)},
                        {"exact", exact}});
  }
  for (std::size_t layer = 0; layer < block.layers.size(); ++layer)
    layers.push_back(layer_json(block.layers[layer], plan.maps[layer], blobs));
  std::string text = block.text;
  if (plan.binning > 1)
    text += fmt::format(" Shown with {0} x {0} cells averaged into one.", plan.binning);
  return {{"kind", "pictures"},
          {"title", block.title},
          {"text", text},
          {"rows", plan.rows},
          {"cols", plan.cols},
          {"cell", cell_json(block.layout)},
          {"gain", block.gain_dn_per_e},
          {"white", block.white_dn},
          {"pictures", pictures},
          {"layers", layers}};
}

// Full resolution in the middle, for readers of a binned picture.
PicturesBlock middle_crop(const PicturesBlock& block, int largest) {
  const auto place = [largest](int size, int cell) {
    const int side = std::min(packed_size(largest, cell) * cell, size);
    return std::pair{(size - side) / 2 / cell * cell, side};
  };
  const auto [row, rows] = place(block.rows, block.layout.rows());
  const auto [col, cols] = place(block.cols, block.layout.cols());
  PicturesBlock crop = block;
  crop.rows = rows;
  crop.cols = cols;
  crop.layers.clear();
  crop.title += ", full resolution";
  crop.text = fmt::format("The middle of the frame, from column {} and row {}.", col, row);
  for (ReportPicture& picture : crop.pictures)
    picture.dn = part_of(picture.dn, {row, col, rows, cols});
  return crop;
}

// As large as the budget allows.
Json crop_json(const PicturesBlock& block, double budget, std::vector<Blob>& blobs) {
  for (int side = kCropSide;; side /= 2) {
    const PicturesBlock crop = middle_crop(block, side);
    const Plan plan = make_plan(crop, 1);
    const double part = step_that_fits(crop, plan, budget);
    if (part > 0 || side <= kSmallestCrop)
      return block_json(crop, plan, part > 0 ? part : kSteps.back(), blobs);
  }
}

}  // namespace

Json pictures_json(const PicturesBlock& block, double budget, std::vector<Blob>& blobs) {
  MALUS_REQUIRE(block.noise.empty() ||
                static_cast<int>(block.noise.size()) == block.layout.channels());
  for (int binning = 1;; ++binning) {
    const Plan plan = make_plan(block, binning);
    const double part =
        step_that_fits(block, plan, binning == 1 ? budget : budget * (1 - kCropShare));
    const bool smallest = plan.rows <= block.layout.rows() && plan.cols <= block.layout.cols();
    if (part == 0 && !smallest) continue;
    Json blocks = Json::array({block_json(block, plan, part > 0 ? part : kSteps.back(), blobs)});
    if (binning > 1 && !block.pictures.empty())
      blocks.push_back(crop_json(block, budget * kCropShare, blobs));
    return blocks;
  }
}

}  // namespace malus::internal
