#include "malus/io/internal/tiff_file.h"

#include "malus/base/error.h"

#include <algorithm>
#include <array>
#include <string>

#include <fmt/format.h>

namespace malus::internal {

namespace fs = std::filesystem;

void cut_tiff(const fs::path& path, std::string_view what) {
  throw InputError(path.string(), fmt::format("the TIFF file ends before its {}", what),
                   "it is damaged or an incomplete copy: copy or record it again");
}

std::uint64_t bytes_of_tiff_type(std::uint16_t type) {
  constexpr std::array<std::uint8_t, 19> kBytes = {0, 1, 1, 2, 4, 8, 1, 1, 2, 4,
                                                   8, 4, 8, 4, 0, 0, 8, 8, 8};
  return type < kBytes.size() ? kBytes[type] : 0;
}

TiffFile tiff_file(const fs::path& path, std::uintmax_t file_bytes, std::uintmax_t base) {
  constexpr std::size_t kPlain = 8, kBig = 16;
  const auto head =
      read_part(path, base, static_cast<std::size_t>(std::min<std::uintmax_t>(file_bytes, kBig)));
  if (head.size() < kPlain) cut_tiff(path, "directory");
  const bool big_endian = head[0] == 'M';
  const bool big_tiff = load_number<std::uint16_t>(head, 2, big_endian) == 43;
  if (big_tiff && head.size() < kBig) cut_tiff(path, "directory");
  TiffFile file{path, file_bytes, big_endian, big_tiff, 0, base};
  file.first_directory = file.number(head, static_cast<std::size_t>(file.link_at()));
  return file;
}

TiffEntries tiff_entries(const TiffFile& file, std::uint64_t at, std::string_view name) {
  const std::uint64_t count_bytes = file.big_tiff ? 8 : 2, entry_bytes = file.entry_bytes();
  if (!file.within(at, count_bytes)) cut_tiff(file.path, name);
  const auto head = read_part(file.path, file.base + at, static_cast<std::size_t>(count_bytes));
  const std::uint64_t entries = file.big_tiff
                                    ? load_number<std::uint64_t>(head, 0, file.big_endian)
                                    : load_number<std::uint16_t>(head, 0, file.big_endian);
  // The place of the next directory is a part of this one.
  if (entries > file.file_bytes / entry_bytes ||
      !file.within(at + count_bytes, entries * entry_bytes + file.number_bytes()))
    cut_tiff(file.path, fmt::format("{}'s end", name));
  const auto next_at = static_cast<std::size_t>(entries * entry_bytes);
  TiffEntries read{read_part(file.path, file.base + at + count_bytes,
                             next_at + static_cast<std::size_t>(file.number_bytes())),
                   0};
  read.next = file.number(read.bytes, next_at);
  read.bytes.resize(next_at);
  return read;
}

TiffTags::TiffTags(const TiffFile& file, std::uint64_t at, std::string_view name)
    : file_(file), entries_(tiff_entries(file, at, name)) {
  for (std::size_t first = 0; first < entries_.bytes.size(); first += file.entry_bytes())
    at_.emplace(file.tag(entry(first)), first);
}

TiffTags::Values TiffTags::values(TiffTag tag, std::initializer_list<std::uint16_t> types,
                                  std::uint64_t most) const {
  const auto found = at_.find(tag);
  if (found == at_.end()) return {};
  const Bytes entry = this->entry(found->second);
  const std::uint16_t type = file_.type(entry);
  if (std::find(types.begin(), types.end(), type) == types.end()) return {};
  const auto each = static_cast<std::size_t>(bytes_of_tiff_type(type));
  const std::uint64_t held = file_.number(entry, 4);
  const auto count = static_cast<std::size_t>(std::min(held, most));
  const auto values_at = static_cast<std::size_t>(4 + file_.number_bytes());
  if (held <= file_.number_bytes() / each) {
    const Bytes inside = entry.subspan(values_at, count * each);
    return {{inside.begin(), inside.end()}, each};
  }
  const std::uint64_t at = file_.number(entry, values_at);
  if (count > file_.file_bytes / each || !file_.within(at, count * each)) return {};
  return {read_part(file_.path, file_.base + at, count * each), each};
}

std::vector<std::uint64_t> TiffTags::all(TiffTag tag, std::uint64_t most) const {
  const auto [bytes, each] = values(tag, {1, 3, 4, 13, 16, 18}, most);
  std::vector<std::uint64_t> all;
  for (std::size_t at = 0; at < bytes.size(); at += each)
    all.push_back(each == 1   ? bytes[at]
                  : each == 2 ? load_number<std::uint16_t>(bytes, at, file_.big_endian)
                  : each == 4 ? load_number<std::uint32_t>(bytes, at, file_.big_endian)
                              : load_number<std::uint64_t>(bytes, at, file_.big_endian));
  return all;
}

std::uint64_t TiffTags::one(TiffTag tag, std::uint64_t otherwise) const {
  const auto first = all(tag, 1);
  return first.empty() ? otherwise : first[0];
}

std::string TiffTags::text(TiffTag tag, std::uint64_t most) const {
  const auto bytes = values(tag, {2}, most).bytes;
  return {bytes.begin(), std::find(bytes.begin(), bytes.end(), 0)};
}

std::optional<double> TiffTags::rational(TiffTag tag) const {
  const auto bytes = values(tag, {5}, 1).bytes;
  if (bytes.empty()) return std::nullopt;
  return static_cast<double>(load_number<std::uint32_t>(bytes, 0, file_.big_endian)) /
         load_number<std::uint32_t>(bytes, 4, file_.big_endian);
}

}  // namespace malus::internal
