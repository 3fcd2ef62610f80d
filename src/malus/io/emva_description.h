// EMVA 1288 measurement descriptions (the text file beside the images of the EMVA 1288 data sets,
// format version 3): "n bits width height", "b exposure_ns photons", "d exposure_ns", "i file".
#pragma once

#include "malus/io/session.h"

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

struct EmvaSession {
  Session session;
  std::vector<std::string> notes;  ///< what was left out: absent images, sets without any
  int missing_images = 0;
};

/// Bright sets become `flat` groups, dark sets `bias` groups, both with exposure_s and in file
/// order; `level` counts the bright sets from 1. White is 2^bits - 1. Images that are absent are
/// left out with a note. Throws InputError naming the line, and where no dark set is left.
EmvaSession load_emva_description(const std::filesystem::path& path);
/// From text; folder is what image names start from.
EmvaSession parse_emva_description(std::string_view text, const std::filesystem::path& source,
                                   const std::filesystem::path& folder, bool check_files = true);

}  // namespace malus
