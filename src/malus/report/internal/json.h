// The contract of web/src/contract.ts as JSON.
#pragma once

#include "malus/report/report.h"
#include "malus/report/write_report.h"

#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace malus::internal {

using Json = nlohmann::ordered_json;

/// The text of one raster, put into the page under its id.
struct Blob {
  std::string id, text;
};

/// null where the value is not finite: JSON has no other way to say so.
Json json_number(double value);

/// The whole report; pictures go to `blobs`.
Json report_json(const Report& report, const ReportSettings& settings, std::vector<Blob>& blobs);

/// A list of viewer blocks within a share of the budget, in characters of the file: the pictures,
/// and where they had to be binned a full-resolution crop. Contract: the pictures have the block's
/// size.
Json pictures_json(const PicturesBlock& block, double budget, std::vector<Blob>& blobs);

const char* palette_name(Palette palette);

/// Tukey's box of a sample: lower whisker, quartiles, upper whisker; the values beyond the
/// whiskers.
struct Box {
  double parts[5] = {};
  std::vector<double> outliers;
};
/// Contract: sample holds a finite value.
Box box_of(std::vector<double> sample);

}  // namespace malus::internal
