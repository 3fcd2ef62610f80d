// A GenICam camera (GigE Vision, USB3 Vision, or Aravis' own fake) behind a small interface. Aravis
// types stay in camera.cpp.
#pragma once

#include "malus/image/raw_frame.h"
#include "malus/io/raw_format.h"

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

namespace malus {

struct CameraIdentity {
  std::string id, vendor, model, serial, protocol, address;
  std::vector<std::string> pixel_formats;  ///< filled by describe_camera
};

struct ValueRange {
  double low = 0, high = 0;
};

struct FrameSize {
  int width = 0, height = 0;
};

/// A frame as it came: still packed.
struct CameraFrame {
  std::uint64_t number = 0;  ///< the camera's own count: gaps are lost frames
  RawFormat format = RawFormat::kMono16;
  int bits = 0;  ///< significant bits
  int rows = 0, cols = 0;
  std::vector<std::uint8_t> bytes;
};

enum class FrameStatus {
  kWhole,
  kDamaged,  ///< packets are missing
  kNone,     ///< nothing came in time
};

/// What a stream knows of itself since its start.
struct StreamCounts {
  std::uint64_t damaged = 0;     ///< frames with missing packets
  std::uint64_t unreceived = 0;  ///< frames that found no free buffer
};

/// Cameras on all interfaces; the fake one only when asked for.
std::vector<CameraIdentity> list_cameras(bool with_fake);
/// The same with its pixel formats. Throws InputError.
CameraIdentity describe_camera(const std::string& id);

/// An open camera. Every call throws InputError that names the camera and what it answered.
class Camera {
 public:
  /// id as listed; empty = the first real one. "Fake_1" is Aravis' fake camera.
  explicit Camera(const std::string& id);
  ~Camera();
  Camera(const Camera&) = delete;
  Camera& operator=(const Camera&) = delete;

  std::string name() const;  ///< vendor and model
  ValueRange gain_range_db() const;
  ValueRange exposure_range_s() const;
  /// Gain, exposure, black level, white balance, gamma: automatic functions off, where the camera
  /// has them.
  void turn_automatics_off();
  /// Empty: the deepest monochrome or Bayer format that decode_raw knows. Returns the name in
  /// force.
  std::string set_pixel_format(const std::string& name);
  /// 0 = the whole sensor. A camera may round it to its own steps.
  void set_size(int width, int height);
  FrameSize size() const;
  void set_black_level(double level);
  void set_feature(const std::string& name, const std::string& value);
  void set_gain_db(double gain_db);
  void set_exposure_s(double exposure_s);
  /// 0 = the highest that the camera has at its exposure. A camera may bind the exposure to the
  /// time of a frame, so the one that is set last may change the other.
  void set_frame_rate_hz(double rate_hz);
  /// A rate so low that this exposure fits into a frame.
  void make_room_for(double exposure_s);
  /// What the camera reports. Of the frame rate 0 where it tells none.
  double gain_db() const;
  double exposure_s() const;
  double frame_rate_hz() const;

  /// Starts streaming with 8 to 1024 frames in flight, as many as fit into so much memory.
  void start(std::size_t buffer_bytes);
  void stop();
  /// Waits for the next frame; it is filled in when it came whole.
  FrameStatus next(CameraFrame& frame, double timeout_s);
  /// Contract: between start and stop.
  StreamCounts counts() const;

 private:
  struct Handle;
  std::unique_ptr<Handle> handle_;
};

}  // namespace malus
