// TIFF files of several pages, byte by byte.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "deflated.h"

namespace malus::testing {

// One channel of 16 bits in one strip.
struct TiffPage {
  std::uint32_t rows = 4, cols = 6;
  std::uint16_t first_value = 0;  // of the pixels, which count on
  std::uint32_t subfile = 0;      // 1: a thumbnail
  bool deflate = false;
  std::uint16_t bits = 16;        // as the directory says
  std::uint16_t photometric = 1;  // 0: 0 is white

  std::string strip() const {
    std::string bytes;
    for (std::uint32_t i = 0; i < rows * cols; ++i) {
      const auto value = static_cast<std::uint16_t>(first_value + i);
      bytes += {static_cast<char>(value & 0xff), static_cast<char>(value >> 8)};
    }
    return deflate ? deflated(bytes) : bytes;
  }
};

// Little-endian; big: BigTIFF. Pixels of a page lie before its directory.
class TiffStack {
 public:
  explicit TiffStack(const std::vector<TiffPage>& pages, bool big = false) : big_(big) {
    bytes_ = big ? std::string("II\x2b\0\x08\0\0\0", 8) : std::string("II*\0", 4);
    std::size_t link = bytes_.size();
    put(0, place_bytes());
    for (const TiffPage& page : pages) {
      strips_.push_back(bytes_.size());
      const std::string strip = page.strip();
      bytes_ += strip + std::string(strip.size() % 2, '\0');
      write_place(link, bytes_.size());
      directories_.push_back(bytes_.size());
      link = directory(page, strips_.back(), strip.size());
    }
    last_link_ = link;
  }
  const std::string& bytes() const { return bytes_; }
  std::size_t strip_at(std::size_t page) const { return strips_[page]; }
  std::size_t directory_at(std::size_t page) const { return directories_[page]; }
  // What the last page names as the next one.
  std::string ending_with(std::size_t place) const {
    TiffStack copy = *this;
    copy.write_place(last_link_, place);
    return copy.bytes_;
  }

 private:
  std::size_t place_bytes() const { return big_ ? 8 : 4; }
  void put(std::uint64_t value, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i) bytes_ += static_cast<char>(value >> (8 * i));
  }
  void write_place(std::size_t at, std::uint64_t value) {
    for (std::size_t i = 0; i < place_bytes(); ++i)
      bytes_[at + i] = static_cast<char>(value >> (8 * i));
  }
  void entry(std::uint16_t tag, std::uint64_t value) {
    constexpr std::uint16_t kLong = 4;
    put(tag, 2);
    put(kLong, 2);
    put(1, place_bytes());
    put(value, place_bytes());
  }
  // Returns where its link to the next one is.
  std::size_t directory(const TiffPage& page, std::size_t strip_at, std::size_t strip_bytes) {
    put(10, big_ ? 8 : 2);
    entry(254, page.subfile);
    entry(256, page.cols);
    entry(257, page.rows);
    entry(258, page.bits);
    entry(259, page.deflate ? 8 : 1);
    entry(262, page.photometric);
    entry(273, strip_at);
    entry(277, 1);
    entry(278, page.rows);
    entry(279, strip_bytes);
    put(0, place_bytes());
    return bytes_.size() - place_bytes();
  }

  bool big_;
  std::string bytes_;
  std::vector<std::size_t> strips_, directories_;
  std::size_t last_link_ = 0;
};

}  // namespace malus::testing
