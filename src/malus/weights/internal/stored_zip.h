// Archives whose entries are stored as they are, which is how torch.save and NumPy's savez write
// theirs. Nothing is unpacked: an entry is a part of the archive's own bytes, so no size in it can
// make the reader take memory. Format: PKWARE APPNOTE 6.3.10, sections 4.3 to 4.5 (ZIP64 too).
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <string>

namespace malus {

struct ZipEntry {
  std::span<const std::byte> bytes;  ///< inside the archive's
  std::uint32_t crc32 = 0;           ///< as the archive states it; not looked at by the parser
};

/// The entries by name; they live as long as the archive's bytes. name is for messages. Throws
/// InputError where a place or length does not fit the file, an entry is packed or encrypted, or
/// two have one name.
std::map<std::string, ZipEntry> parse_stored_zip(std::span<const std::byte> archive,
                                                 const std::string& name);

/// Whether the bytes are those that were stored.
bool intact(const ZipEntry& entry);

}  // namespace malus
