// Sensor layouts are data: a small repeating cell that gives every position its colour and
// polarizer angle.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace malus {

enum class Color { kMono, kRed, kGreen1, kGreen2, kBlue };

/// One position of the cell.
struct Site {
  Color color = Color::kMono;
  /// Polarizer axis, counter-clockwise: 0, 45, 90 or 135; none without a polarizer.
  std::optional<int> angle_deg;
  bool operator==(const Site&) const = default;
};

/// Where in a cell the first pixel of a mosaic lies.
struct CellPhase {
  int row = 0, col = 0;
  bool operator==(const CellPhase&) const = default;
};

/// A repeating cell of rows() x cols() sites. Channels are numbered in mosaic order, row by row of
/// the cell, one per site.
class SensorLayout {
 public:
  /// Rows or columns of the largest cell, and how many channels that has.
  static constexpr int kLargestCell = 8, kMostChannels = kLargestCell * kLargestCell;

  /// One mono channel.
  SensorLayout();
  /// Named: mono, bayer-{rggb,bggr,grbg,gbrg}, polar-mono, polar-bayer-{rggb,bggr,grbg,gbrg}.
  /// Throws InputError that lists the names and the nearest one.
  static SensorLayout named(std::string_view name);
  /// Custom cell from site names, e.g. {{"R0","R45"},{"R135","R90"}} or {{"0","45"},{"135","90"}}
  /// or {{"R","G1"},{"G2","B"}}. Throws InputError on an unknown site, a ragged or empty cell, or
  /// one larger than kLargestCell a side.
  static SensorLayout from_sites(const std::vector<std::vector<std::string>>& rows);
  static std::vector<std::string> known_names();

  int rows() const { return rows_; }
  int cols() const { return cols_; }
  int channels() const { return rows_ * cols_; }
  /// Channel of a mosaic position; row and col >= 0.
  int channel_at(int row, int col) const { return (row % rows_) * cols_ + col % cols_; }
  const Site& site(int channel) const { return sites_.at(static_cast<std::size_t>(channel)); }
  /// "R90", "G1_45", "B", "135" (mono polarization), "mono".
  std::string channel_name(int channel) const;
  std::vector<std::string> channel_names() const;
  /// The registered name, or "custom".
  const std::string& name() const { return name_; }

  bool polarized() const;  ///< all four angles 0, 45, 90, 135 are present for every colour
  bool colored() const;    ///< more than one colour
  /// The colours present, in the order red, green1, green2, blue, or mono alone.
  std::vector<Color> colors() const;
  /// Channel with this colour and angle, or -1.
  int find(Color color, std::optional<int> angle_deg) const;
  /// The phase at which a mosaic of this layout is one of `other`: the four Bayer orders are one
  /// sensor, read out from different pixels, and both greens count as one colour; without colours
  /// (mono, polar-mono) it is what a coloured sensor sees of grey light. None where the sensors
  /// differ.
  std::optional<CellPhase> phase_in(const SensorLayout& other) const;
  bool operator==(const SensorLayout& other) const {
    return rows_ == other.rows_ && cols_ == other.cols_ && sites_ == other.sites_;
  }

 private:
  int rows_ = 1, cols_ = 1;
  std::vector<Site> sites_;
  std::string name_;
};

std::string_view color_name(Color color);  ///< "mono", "R", "G1", "G2", "B"

}  // namespace malus
