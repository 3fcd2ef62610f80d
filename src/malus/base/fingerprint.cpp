#include "malus/base/fingerprint.h"

#include "malus/base/error.h"

#include <cstddef>
#include <fstream>

namespace malus {

std::string file_fingerprint(const std::filesystem::path& path) {
  std::ifstream file(path, std::ios::binary);
  std::string piece(std::size_t{1} << 20, '\0');
  Fingerprint print;
  while (file) {
    file.read(piece.data(), static_cast<std::streamsize>(piece.size()));
    print.add(std::string_view(piece).substr(0, static_cast<std::size_t>(file.gcount())));
  }
  if (!file.eof()) throw InputError(path.string(), "cannot be read", "check the name and the disk");
  return print.text();
}

}  // namespace malus
