// What `malus denoise` leaves beside a result (<stem>_denoised.json) so that a report can be made
// of it later.
#pragma once

#include "malus/io/frame_file.h"

#include <filesystem>
#include <optional>
#include <string>

#include "report_pages.h"
#include <nlohmann/json.hpp>

namespace malus::app {

/// What is needed to read the input again and to know its noise, added to the run's own record.
/// raw_format: of headerless input. result: the denoised mosaic; paths are kept relative to its
/// folder where that is possible.
nlohmann::ordered_json run_record(const RawFrame& before, const NoiseProfile& profile,
                                  const std::filesystem::path& input,
                                  std::optional<RawFormat> raw_format,
                                  const std::filesystem::path& result, nlohmann::ordered_json run);

/// The clean scene of a frame.
struct Reference {
  std::filesystem::path path;
  double ratio = 1;                ///< how much more light it had
  std::optional<double> black_dn;  ///< where its file tells none; unset: the frame's
};

/// Puts the scene into `frame`, divided by its ratio. That a file has the frame's black level for
/// want of its own is warned of unless that is stated to be everybody's. Throws InputError, also
/// where it is not of the frame's size.
void add_reference(DenoisedFrame& frame, const Reference& reference, bool black_stated);

/// Opens every file before anything is done: throws InputError for one that is missing or no
/// mosaic, and with a model, by_model, for a frame that is denoised (require_raw). Returns the
/// first whose layout neither it nor the options tell; empty where there is none.
std::filesystem::path check_inputs(const std::vector<std::filesystem::path>& frames,
                                   const std::vector<std::filesystem::path>& references,
                                   const FrameOptions& options, bool by_model);

/// The metrics of the frame, and of its result; the frame must have a reference.
void measure_before(DenoisedFrame& frame);
void measure_after(DenoisedFrame& frame);
/// Both, for the record.
nlohmann::ordered_json metrics_json(const DenoisedFrame& frame);
/// The same for people, a row per metric; empty where the frame has no reference.
std::string metrics_text(const DenoisedFrame& frame);

/// Notes in a record what add_reference was given.
void name_reference(nlohmann::ordered_json& record, const Reference& reference,
                    const std::filesystem::path& result);

/// And where its variance lies, if the run wrote it.
void name_variance(nlohmann::ordered_json& record, const std::filesystem::path& variance,
                   const std::filesystem::path& result);

/// Loads input and result of a record, and the variance where its file is still there. Throws
/// InputError.
DenoisedFrame load_run(const std::filesystem::path& record_file,
                       const nlohmann::ordered_json& record);

}  // namespace malus::app
