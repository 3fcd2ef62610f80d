// TIFF files byte by byte: what no library would write, and what must be known exactly.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

namespace malus::testing {

// A little-endian TIFF directory, entry by entry.
class TiffDirectory {
 public:
  void bytes(int tag, const std::string& values) { add(tag, 1, values.size(), values); }
  void text(int tag, std::string value) {
    value += '\0';
    add(tag, 2, value.size(), value);
  }
  void shorts(int tag, const std::vector<std::uint16_t>& values) {
    add(tag, 3, values.size(), packed(values));
  }
  void longs(int tag, const std::vector<std::uint32_t>& values) {
    add(tag, 4, values.size(), packed(values));
  }
  void rationals(int tag, int type, const std::vector<std::int32_t>& values) {
    add(tag, type, values.size() / 2, packed(values));
  }
  std::size_t size() const { return 2 + 12 * entries_.size() + 4 + extra_size(); }

  /// The directory as it lies at `offset` of the file.
  std::string write(std::size_t offset) const {
    std::string head =
        packed(std::vector<std::uint16_t>{static_cast<std::uint16_t>(entries_.size())});
    std::string extra;
    const std::size_t extra_at = offset + 2 + 12 * entries_.size() + 4;
    for (const Entry& entry : entries_) {
      head += packed(std::vector<std::uint16_t>{static_cast<std::uint16_t>(entry.tag),
                                                static_cast<std::uint16_t>(entry.type)});
      head += packed(std::vector<std::uint32_t>{static_cast<std::uint32_t>(entry.count)});
      if (entry.data.size() <= 4) {
        std::string inline_value = entry.data;
        inline_value.resize(4, '\0');
        head += inline_value;
      } else {
        head +=
            packed(std::vector<std::uint32_t>{static_cast<std::uint32_t>(extra_at + extra.size())});
        extra += entry.data;
        if (extra.size() % 2) extra += '\0';
      }
    }
    return head + std::string(4, '\0') + extra;
  }

 private:
  struct Entry {
    int tag, type;
    std::size_t count;
    std::string data;
  };
  template <class T>
  static std::string packed(const std::vector<T>& values) {
    std::string out(values.size() * sizeof(T), '\0');
    std::memcpy(out.data(), values.data(), out.size());
    return out;
  }
  std::size_t extra_size() const {
    std::size_t total = 0;
    for (const Entry& entry : entries_)
      if (entry.data.size() > 4) total += (entry.data.size() + 1) / 2 * 2;
    return total;
  }
  void add(int tag, int type, std::size_t count, std::string data) {
    entries_.push_back({tag, type, count, std::move(data)});
  }
  std::vector<Entry> entries_;
};

}  // namespace malus::testing
