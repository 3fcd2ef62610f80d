#include "malus/capture/camera.h"

#include "malus/base/text.h"

#include <algorithm>
#include <cstring>
#include <iterator>
#include <optional>

#include <arv.h>
#include <fmt/format.h>

namespace malus {
namespace {

struct KnownFormat {
  ArvPixelFormat pixel;
  RawFormat raw;
  int bits;
};

// Unpacked 10 and 12 bit formats are 16-bit words whose upper bits are zero. Ordered by depth,
// unpacked first.
constexpr ArvPixelFormat kMono10p = 0x010a0046;  // PFNC; Aravis 0.8.26 has no name for it
constexpr KnownFormat kFormats[] = {
    {ARV_PIXEL_FORMAT_MONO_16, RawFormat::kMono16, 16},
    {ARV_PIXEL_FORMAT_BAYER_RG_16, RawFormat::kMono16, 16},
    {ARV_PIXEL_FORMAT_BAYER_GR_16, RawFormat::kMono16, 16},
    {ARV_PIXEL_FORMAT_BAYER_GB_16, RawFormat::kMono16, 16},
    {ARV_PIXEL_FORMAT_BAYER_BG_16, RawFormat::kMono16, 16},
    {ARV_PIXEL_FORMAT_MONO_12, RawFormat::kMono16, 12},
    {ARV_PIXEL_FORMAT_BAYER_RG_12, RawFormat::kMono16, 12},
    {ARV_PIXEL_FORMAT_BAYER_GR_12, RawFormat::kMono16, 12},
    {ARV_PIXEL_FORMAT_BAYER_GB_12, RawFormat::kMono16, 12},
    {ARV_PIXEL_FORMAT_BAYER_BG_12, RawFormat::kMono16, 12},
    {0x010C0047, RawFormat::kMono12p, 12},  // Mono12p, PFNC
    {ARV_PIXEL_FORMAT_MONO_12_PACKED, RawFormat::kMono12Packed, 12},
    {ARV_PIXEL_FORMAT_BAYER_RG_12P, RawFormat::kMono12p, 12},
    {ARV_PIXEL_FORMAT_BAYER_GR_12P, RawFormat::kMono12p, 12},
    {ARV_PIXEL_FORMAT_BAYER_GB_12P, RawFormat::kMono12p, 12},
    {ARV_PIXEL_FORMAT_BAYER_BG_12P, RawFormat::kMono12p, 12},
    {ARV_PIXEL_FORMAT_BAYER_RG_12_PACKED, RawFormat::kMono12Packed, 12},
    {ARV_PIXEL_FORMAT_BAYER_GR_12_PACKED, RawFormat::kMono12Packed, 12},
    {ARV_PIXEL_FORMAT_BAYER_GB_12_PACKED, RawFormat::kMono12Packed, 12},
    {ARV_PIXEL_FORMAT_BAYER_BG_12_PACKED, RawFormat::kMono12Packed, 12},
    {ARV_PIXEL_FORMAT_MONO_10, RawFormat::kMono16, 10},
    {ARV_PIXEL_FORMAT_BAYER_RG_10, RawFormat::kMono16, 10},
    {ARV_PIXEL_FORMAT_BAYER_GR_10, RawFormat::kMono16, 10},
    {ARV_PIXEL_FORMAT_BAYER_GB_10, RawFormat::kMono16, 10},
    {ARV_PIXEL_FORMAT_BAYER_BG_10, RawFormat::kMono16, 10},
    {kMono10p, RawFormat::kMono10p, 10},
    {ARV_PIXEL_FORMAT_BAYER_RG_10P, RawFormat::kMono10p, 10},
    {ARV_PIXEL_FORMAT_BAYER_GR_10P, RawFormat::kMono10p, 10},
    {ARV_PIXEL_FORMAT_BAYER_GB_10P, RawFormat::kMono10p, 10},
    {ARV_PIXEL_FORMAT_BAYER_BG_10P, RawFormat::kMono10p, 10},
    {ARV_PIXEL_FORMAT_MONO_8, RawFormat::kMono8, 8},
    {ARV_PIXEL_FORMAT_BAYER_RG_8, RawFormat::kMono8, 8},
    {ARV_PIXEL_FORMAT_BAYER_GR_8, RawFormat::kMono8, 8},
    {ARV_PIXEL_FORMAT_BAYER_GB_8, RawFormat::kMono8, 8},
    {ARV_PIXEL_FORMAT_BAYER_BG_8, RawFormat::kMono8, 8},
};

const KnownFormat* known_format(ArvPixelFormat pixel) {
  const auto found = std::find_if(std::begin(kFormats), std::end(kFormats),
                                  [&](const KnownFormat& f) { return f.pixel == pixel; });
  return found == std::end(kFormats) ? nullptr : found;
}

std::string text_of(const char* text) { return text ? text : ""; }

// Aravis reports by GError.
class ErrorSlot {
 public:
  ErrorSlot() = default;
  ~ErrorSlot() { g_clear_error(&error_); }
  ErrorSlot(const ErrorSlot&) = delete;
  ErrorSlot& operator=(const ErrorSlot&) = delete;
  GError** out() {
    g_clear_error(&error_);
    return &error_;
  }
  bool failed() const { return error_ != nullptr; }
  std::string message() const { return error_ ? text_of(error_->message) : ""; }

 private:
  GError* error_ = nullptr;
};

// False where the buffer holds less than its own description says.
bool copy_frame(ArvBuffer* buffer, CameraFrame& frame) {
  const auto* format = known_format(arv_buffer_get_image_pixel_format(buffer));
  frame.number = arv_buffer_get_frame_id(buffer);
  frame.rows = arv_buffer_get_image_height(buffer);
  frame.cols = arv_buffer_get_image_width(buffer);
  std::size_t size = 0;
  const auto* bytes = static_cast<const std::uint8_t*>(arv_buffer_get_data(buffer, &size));
  if (!format || frame.rows <= 0 || frame.cols <= 0 || !bytes) return false;
  const std::size_t wanted = raw_format_bytes(format->raw, frame.rows, frame.cols);
  if (size < wanted) return false;
  frame.format = format->raw;
  frame.bits = format->bits;
  frame.bytes.assign(bytes, bytes + wanted);
  return true;
}

void update_list(bool with_fake) {
  with_fake ? arv_enable_interface("Fake") : arv_disable_interface("Fake");
  arv_update_device_list();
}

}  // namespace

struct Camera::Handle {
  ArvCamera* camera = nullptr;
  ArvStream* stream = nullptr;
  std::string id;

  ~Handle() {
    g_clear_object(&stream);
    g_clear_object(&camera);
  }
  [[noreturn]] void fail(const std::string& what, const std::string& answer) const {
    throw InputError(fmt::format("camera {}", id), fmt::format("{} failed ({})", what, answer),
                     "check the cable, other programs that hold the camera, and the plan's values");
  }
  void check(const ErrorSlot& error, const std::string& what) const {
    if (error.failed()) fail(what, error.message());
  }
};

std::vector<CameraIdentity> list_cameras(bool with_fake) {
  update_list(with_fake);
  std::vector<CameraIdentity> cameras;
  for (unsigned i = 0; i < arv_get_n_devices(); ++i)
    cameras.push_back({text_of(arv_get_device_id(i)),
                       text_of(arv_get_device_vendor(i)),
                       text_of(arv_get_device_model(i)),
                       text_of(arv_get_device_serial_nbr(i)),
                       text_of(arv_get_device_protocol(i)),
                       text_of(arv_get_device_address(i)),
                       {}});
  return cameras;
}

namespace {

std::string cameras_here() {
  std::vector<std::string> ids;
  for (const auto& camera : list_cameras(false)) ids.push_back(camera.id);
  return "cameras here: " + (ids.empty() ? "none" : joined(ids)) + "; the fake camera is Fake_1";
}

}  // namespace

CameraIdentity describe_camera(const std::string& id) {
  CameraIdentity identity;
  for (const auto& listed : list_cameras(id.starts_with("Fake")))
    if (listed.id == id) identity = listed;
  if (identity.id.empty())
    throw InputError(fmt::format("camera {}", id), "not found", cameras_here());
  ErrorSlot error;
  ArvCamera* camera = arv_camera_new(id.c_str(), error.out());
  if (!camera)
    throw InputError(fmt::format("camera {}", id), error.message(), "is another program using it?");
  guint count = 0;
  const char** formats =
      arv_camera_dup_available_pixel_formats_as_strings(camera, &count, error.out());
  for (guint i = 0; i < count; ++i) identity.pixel_formats.emplace_back(text_of(formats[i]));
  g_free(formats);
  g_object_unref(camera);
  if (error.failed())
    throw InputError(fmt::format("camera {}", id),
                     fmt::format("does not tell its pixel formats ({})", error.message()),
                     "is another program using it?");
  return identity;
}

Camera::Camera(const std::string& id) : handle_(std::make_unique<Handle>()) {
  const auto cameras = list_cameras(id.starts_with("Fake"));
  handle_->id = id.empty() && !cameras.empty() ? cameras[0].id : id;
  const bool listed = std::any_of(cameras.begin(), cameras.end(),
                                  [&](const auto& c) { return c.id == handle_->id; });
  ErrorSlot error;
  // A camera outside the list may still answer under its address.
  if (!handle_->id.empty()) handle_->camera = arv_camera_new(handle_->id.c_str(), error.out());
  if (!handle_->camera)
    throw InputError(id.empty() ? "camera" : fmt::format("camera {}", id),
                     listed ? fmt::format("cannot be opened ({})", error.message()) : "none found",
                     cameras_here());
  // The largest packets that the link carries; a link that does not tell keeps the camera's own.
  if (arv_camera_is_gv_device(handle_->camera))
    arv_camera_gv_auto_packet_size(handle_->camera, error.out());
}

Camera::~Camera() {
  if (handle_->stream) arv_camera_stop_acquisition(handle_->camera, nullptr);
}

std::string Camera::name() const {
  ErrorSlot error;
  const auto vendor = text_of(arv_camera_get_vendor_name(handle_->camera, error.out()));
  handle_->check(error, "reading the vendor's name");
  const auto model = text_of(arv_camera_get_model_name(handle_->camera, error.out()));
  handle_->check(error, "reading the camera's name");
  return vendor + " " + model;
}

ValueRange Camera::gain_range_db() const {
  ErrorSlot error;
  ValueRange range;
  arv_camera_get_gain_bounds(handle_->camera, &range.low, &range.high, error.out());
  handle_->check(error, "reading the range of gains");
  return range;
}

ValueRange Camera::exposure_range_s() const {
  ErrorSlot error;
  ValueRange range;
  arv_camera_get_exposure_time_bounds(handle_->camera, &range.low, &range.high, error.out());
  handle_->check(error, "reading the range of exposures");
  return {range.low / 1e6, range.high / 1e6};
}

void Camera::turn_automatics_off() {
  for (const char* feature : {"GainAuto", "ExposureAuto", "BlackLevelAuto", "BalanceWhiteAuto"}) {
    ErrorSlot error;
    if (!arv_camera_is_feature_available(handle_->camera, feature, error.out())) continue;
    arv_camera_set_string(handle_->camera, feature, "Off", error.out());
    handle_->check(error, fmt::format("turning {} off", feature));
  }
  for (const char* feature : {"GammaEnable", "BlackLevelClampingEnable"}) {
    ErrorSlot error;
    if (!arv_camera_is_feature_available(handle_->camera, feature, error.out())) continue;
    arv_camera_set_boolean(handle_->camera, feature, FALSE, error.out());
    handle_->check(error, fmt::format("turning {} off", feature));
  }
}

std::string Camera::set_pixel_format(const std::string& name) {
  ErrorSlot error;
  if (!name.empty()) {
    arv_camera_set_pixel_format_from_string(handle_->camera, name.c_str(), error.out());
    handle_->check(error, fmt::format("setting pixel format {}", name));
  } else {
    guint count = 0;
    gint64* available =
        arv_camera_dup_available_pixel_formats(handle_->camera, &count, error.out());
    handle_->check(error, "reading the pixel formats");
    std::optional<ArvPixelFormat> best;
    for (const auto& format : kFormats)
      for (guint i = 0; i < count && !best; ++i)
        if (static_cast<ArvPixelFormat>(available[i]) == format.pixel) best = format.pixel;
    g_free(available);
    if (!best) handle_->fail("choosing a pixel format", "it has no raw format that malus reads");
    arv_camera_set_pixel_format(handle_->camera, *best, error.out());
    handle_->check(error, "setting the pixel format");
  }
  const auto pixel = arv_camera_get_pixel_format(handle_->camera, error.out());
  handle_->check(error, "reading the pixel format back");
  if (!known_format(pixel)) handle_->fail("setting the pixel format", "malus cannot decode it");
  const auto chosen = text_of(arv_camera_get_pixel_format_as_string(handle_->camera, error.out()));
  handle_->check(error, "reading the pixel format's name");
  return chosen;
}

void Camera::set_size(int width, int height) {
  ErrorSlot error;
  gint whole_width = 0, whole_height = 0;
  arv_camera_get_sensor_size(handle_->camera, &whole_width, &whole_height, error.out());
  handle_->check(error, "reading the sensor's size");
  arv_camera_set_region(handle_->camera, 0, 0, width ? width : whole_width,
                        height ? height : whole_height, error.out());
  handle_->check(error, fmt::format("setting the size {}x{}", width, height));
}

FrameSize Camera::size() const {
  ErrorSlot error;
  gint x = 0, y = 0, width = 0, height = 0;
  arv_camera_get_region(handle_->camera, &x, &y, &width, &height, error.out());
  handle_->check(error, "reading the size back");
  return {width, height};
}

void Camera::set_black_level(double level) {
  ErrorSlot error;
  arv_camera_set_float(handle_->camera, "BlackLevel", level, error.out());
  handle_->check(error, fmt::format("setting the black level {:g}", level));
}

void Camera::set_feature(const std::string& name, const std::string& value) {
  ErrorSlot error;
  arv_device_set_features_from_string(arv_camera_get_device(handle_->camera),
                                      fmt::format("{}={}", name, value).c_str(), error.out());
  handle_->check(error, fmt::format("setting {} = {}", name, value));
}

void Camera::set_gain_db(double gain_db) {
  ErrorSlot error;
  arv_camera_set_gain(handle_->camera, gain_db, error.out());
  handle_->check(error, fmt::format("setting the gain {:g} dB", gain_db));
}

void Camera::set_exposure_s(double exposure_s) {
  ErrorSlot error;
  arv_camera_set_exposure_time(handle_->camera, exposure_s * 1e6, error.out());
  handle_->check(error, fmt::format("setting the exposure {:g} s", exposure_s));
}

void Camera::set_frame_rate_hz(double rate_hz) {
  ErrorSlot error;
  if (!arv_camera_is_frame_rate_available(handle_->camera, error.out())) return;
  if (rate_hz == 0) {
    double low = 0;
    arv_camera_get_frame_rate_bounds(handle_->camera, &low, &rate_hz, error.out());
    handle_->check(error, "reading the range of frame rates");
  }
  arv_camera_set_frame_rate(handle_->camera, rate_hz, error.out());
  handle_->check(error, fmt::format("setting the frame rate {:g} Hz", rate_hz));
}

void Camera::make_room_for(double exposure_s) {
  constexpr double kSlow_hz = 1.0;  // leaves any camera the time to read a frame out
  constexpr double kShare = 0.5;    // of a frame's time
  ErrorSlot error;
  if (!arv_camera_is_frame_rate_available(handle_->camera, error.out())) return;
  double low = 0, high = 0;
  arv_camera_get_frame_rate_bounds(handle_->camera, &low, &high, error.out());
  handle_->check(error, "reading the range of frame rates");
  set_frame_rate_hz(std::min(std::max(low, std::min(kSlow_hz, kShare / exposure_s)), high));
}

double Camera::gain_db() const {
  ErrorSlot error;
  const double gain = arv_camera_get_gain(handle_->camera, error.out());
  handle_->check(error, "reading the gain back");
  return gain;
}

double Camera::exposure_s() const {
  ErrorSlot error;
  const double microseconds = arv_camera_get_exposure_time(handle_->camera, error.out());
  handle_->check(error, "reading the exposure back");
  return microseconds / 1e6;
}

double Camera::frame_rate_hz() const {
  ErrorSlot error;
  if (!arv_camera_is_frame_rate_available(handle_->camera, error.out())) return 0;
  const double rate_hz = arv_camera_get_frame_rate(handle_->camera, error.out());
  handle_->check(error, "reading the frame rate back");
  return rate_hz;
}

void Camera::start(std::size_t buffer_bytes) {
  ErrorSlot error;
  handle_->stream = arv_camera_create_stream(handle_->camera, nullptr, nullptr, error.out());
  handle_->check(error, "opening the stream");
  const auto payload = arv_camera_get_payload(handle_->camera, error.out());
  handle_->check(error, "reading the size of a frame");
  const std::size_t buffers =
      std::clamp<std::size_t>(buffer_bytes / std::max<std::size_t>(payload, 1), 8, 1024);
  for (std::size_t i = 0; i < buffers; ++i)
    arv_stream_push_buffer(handle_->stream, arv_buffer_new_allocate(payload));
  arv_camera_set_acquisition_mode(handle_->camera, ARV_ACQUISITION_MODE_CONTINUOUS, error.out());
  handle_->check(error, "setting continuous acquisition");
  arv_camera_start_acquisition(handle_->camera, error.out());
  handle_->check(error, "starting the acquisition");
}

void Camera::stop() {
  if (!handle_->stream) return;
  ErrorSlot error;
  arv_camera_stop_acquisition(handle_->camera, error.out());
  g_clear_object(&handle_->stream);
  handle_->check(error, "stopping the acquisition");
}

FrameStatus Camera::next(CameraFrame& frame, double timeout_s) {
  MALUS_REQUIRE(handle_->stream);
  ArvBuffer* buffer =
      arv_stream_timeout_pop_buffer(handle_->stream, static_cast<guint64>(timeout_s * 1e6));
  if (!buffer) return FrameStatus::kNone;
  const bool whole =
      arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS && copy_frame(buffer, frame);
  arv_stream_push_buffer(handle_->stream, buffer);
  return whole ? FrameStatus::kWhole : FrameStatus::kDamaged;
}

StreamCounts Camera::counts() const {
  MALUS_REQUIRE(handle_->stream);
  guint64 completed = 0, failures = 0, underruns = 0;
  arv_stream_get_statistics(handle_->stream, &completed, &failures, &underruns);
  return {failures, underruns};
}

}  // namespace malus
