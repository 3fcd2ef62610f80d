#include "malus/polar/legend.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

namespace malus {
namespace {

constexpr Rgb kPanel = {24, 24, 24}, kInk = {235, 235, 235};
constexpr int kGlyphRows = 5, kGlyphCols = 3;
constexpr int kSmallestLabelledPanel = 64;

// Dots of the letters, side by side with a gap between them.
constexpr std::string_view kLetters = "0123456789-+.e";
constexpr std::array<std::string_view, kGlyphRows> kDots = {
    "###  #  ### ### # # ### ### ### ### ###                ",  //
    "# # ##    #   # # # #   #     # # # # #      #      ###",  //
    "# #  #  ###  ## ### ### ###  #  ### ### ### ###     ###",  //
    "# #  #  #     #   #   # # #  #  # #   #      #      #  ",  //
    "### ### ### ###   # ### ###  #  ### ###          #  ###"};

// Whether a letter has a dot there; one that has no glyph is a blank.
bool has_dot(char letter, int row, int col) {
  const std::size_t place = kLetters.find(letter);
  return place != std::string_view::npos &&
         kDots[static_cast<std::size_t>(row)]
              [place * (kGlyphCols + 1) + static_cast<std::size_t>(col)] == '#';
}

void put(Planes& picture, int row, int col, const Rgb& color) {
  if (row < 0 || col < 0 || row >= picture.rows() || col >= picture.cols()) return;
  picture[0](row, col) = color.r;
  picture[1](row, col) = color.g;
  picture[2](row, col) = color.b;
}

void fill(Planes& picture, int row0, int col0, int rows, int cols, const Rgb& color) {
  for (int r = row0; r < row0 + rows; ++r)
    for (int c = col0; c < col0 + cols; ++c) put(picture, r, c, color);
}

int text_width(std::string_view text, int scale) {
  return static_cast<int>(text.size()) * (kGlyphCols + 1) * scale - scale;
}

// Upper left corner at (row, col).
void write(Planes& picture, int row, int col, std::string_view text, int scale) {
  for (char letter : text) {
    for (int r = 0; r < kGlyphRows; ++r)
      for (int c = 0; c < kGlyphCols; ++c)
        if (has_dot(letter, r, c))
          fill(picture, row + r * scale, col + c * scale, scale, scale, kInk);
    col += (kGlyphCols + 1) * scale;
  }
}

void write_centred(Planes& picture, double row, double col, std::string_view text, int scale) {
  write(picture, static_cast<int>(std::lround(row - 0.5 * kGlyphRows * scale)),
        static_cast<int>(std::lround(col - 0.5 * text_width(text, scale))), text, scale);
}

struct Box {
  int row, col, rows, cols;
  int scale;  // screen pixels per font dot; 0: too small for labels
};

// A panel in the lower right corner, `aspect` times as wide as high, about a quarter of the
// picture's shorter side.
Box panel_of(Planes& picture, double aspect) {
  const int shorter = std::min(picture.rows(), picture.cols());
  const int rows = std::clamp(shorter / 4, 32, 320), cols = static_cast<int>(rows * aspect);
  const int margin = rows / 12;
  const Box box{picture.rows() - rows - margin, picture.cols() - cols - margin, rows, cols,
                rows < kSmallestLabelledPanel ? 0 : std::max(1, rows / 60)};
  fill(picture, box.row, box.col, box.rows, box.cols, kPanel);
  return box;
}

bool too_small(const Planes& picture) {
  MALUS_REQUIRE(picture.channels() == 3);
  return std::min(picture.rows(), picture.cols()) < kSmallestPictureWithLegend;
}

}  // namespace

void draw_aolp_wheel(Planes& picture) {
  if (too_small(picture)) return;
  const Box box = panel_of(picture, 1.1);
  const double centre_row = box.row + 0.5 * box.rows, centre_col = box.col + 0.5 * box.cols;
  const double label = 0.5 * box.rows - 0.5 * (kGlyphRows + 2) * box.scale - 1;
  const double outer = label - 0.5 * (kGlyphRows + 3) * box.scale, inner = 0.35 * outer;
  for (int r = box.row; r < box.row + box.rows; ++r)
    for (int c = box.col; c < box.col + box.cols; ++c) {
      const double up = centre_row - (r + 0.5), right = (c + 0.5) - centre_col;
      const double radius = std::hypot(up, right);
      if (radius < inner || radius > outer) continue;
      put(picture, r, c, aolp_color(std::atan2(up, right) * 180 / std::numbers::pi));
    }
  for (const auto& [angle_deg, text] : {std::pair{0, "0"}, {45, "45"}, {90, "90"}, {135, "135"}}) {
    const double a = angle_deg * std::numbers::pi / 180;
    // Wide labels beside the ring step out sideways so that they do not touch it.
    const double side = label + 0.4 * text_width(text, box.scale) * std::abs(std::cos(a));
    write_centred(picture, centre_row - label * std::sin(a), centre_col + side * std::cos(a), text,
                  box.scale);
  }
}

void draw_bar(Planes& picture, const std::function<Rgb(double)>& color_of_fraction,
              const std::array<std::string, 3>& labels) {
  if (too_small(picture)) return;
  std::size_t longest = 1;
  for (const auto& text : labels) longest = std::max(longest, text.size());
  const Box box = panel_of(picture, 0.35 + 0.075 * static_cast<double>(longest));
  const int margin = (kGlyphRows + 3) * box.scale / 2 + 1;
  const int top = box.row + margin, height = box.rows - 2 * margin;
  const int bar = box.rows / 7, left = box.col + 2 * box.scale + 1;
  for (int r = 0; r < height; ++r) {
    const Rgb color = color_of_fraction(1 - (r + 0.5) / height);
    fill(picture, top + r, left, 1, bar, color);
  }
  for (int i = 0; i < 3; ++i)
    write(picture, top + height - height * i / 2 - kGlyphRows * box.scale / 2,
          left + bar + 2 * box.scale, labels[static_cast<std::size_t>(i)], box.scale);
}

}  // namespace malus
