// Flags of every command that takes RAW, and the names of what it writes.
#pragma once

#include "malus/io/frame_file.h"
#include "malus/io/session.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "frame_contents.h"
#include <CLI/CLI.hpp>

namespace malus::app {

/// --layout --black --dark --white --gain --iso --exposure --mean-of --raw-format --size --session.
/// Keep the object alive as long as the command.
class RawOptions {
 public:
  /// Which of the flags mean something to a command: not a gain where it has its own, nor means of
  /// frames where the noise of one counts; dark frames where light is made of raw frames.
  /// polarized: no layout without polarizers makes sense of them.
  struct With {
    bool gain = true, means = true, dark = false, polarized = false;
  };
  void add_to(CLI::App& command) { add_to(command, With()); }
  void add_to(CLI::App& command, With with);
  /// Flags over the session's [sensor]; reads the dark frames. Throws InputError, and
  /// CLI::ValidationError where flags contradict each other.
  FrameOptions resolve() const;
  /// Where a command has one kind of input: files hold what the flag (not the session) says.
  FloatBlack float_black() const {
    return black_dn_.empty() && dark_.empty() ? FloatBlack::kNotSaid : FloatBlack::kHolds;
  }
  std::optional<double> white_dn() const { return white_dn_; }
  bool has_dark() const { return !dark_.empty(); }
  /// What is read besides the frames, which no result may replace; empty names are none.
  std::vector<std::filesystem::path> files_read() const;

 private:
  void check_usage() const;
  std::string layout_, raw_format_, size_;
  std::vector<double> black_dn_;
  std::vector<std::filesystem::path> dark_;
  std::optional<double> white_dn_, gain_db_, iso_, exposure_s_;
  std::optional<int> mean_of_;
  std::filesystem::path session_;
};

/// The frames of the inputs (frame_names, malus/io/frame_stack.h), a stack's each by its own name.
/// options tell whether they are headerless. A file that is not there counts as one frame, so that
/// usage is checked before files are: its reader says so. Throws InputError.
std::vector<std::filesystem::path> frames_of_inputs(
    const std::vector<std::filesystem::path>& inputs, const FrameOptions& options);

/// Of the options what headerless files cannot be read without.
FrameOptions headerless_part(const FrameOptions& options);

/// Reads the headers of frames before any work is done on one of them. Throws InputError.
void require_headers(const std::vector<std::filesystem::path>& frames, const FrameOptions& options);

/// The name without its last ending: `a/b.raw.png` -> `b.raw`; of a stack's frame with its index:
/// `a/b.npy[7]` -> `b_007`.
std::string stem_of(const std::filesystem::path& input);

/// One output name per input: folder / (<stem> + suffix), e.g. suffix "_denoised.tif". Throws
/// InputError when two inputs would write the same file, or one would replace an input or what the
/// run reads besides (references, masks, the model); empty names are none.
std::vector<std::filesystem::path> output_names(
    const std::vector<std::filesystem::path>& inputs, const std::filesystem::path& folder,
    const std::string& suffix, const std::vector<std::filesystem::path>& read_besides = {});

}  // namespace malus::app
