#include "malus/base/unreadable_file.h"

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <string>
#include <system_error>

namespace malus {

bool can_be_opened(const std::filesystem::path& path) {
  std::FILE* file = std::fopen(path.c_str(), "rb");
  if (file) std::fclose(file);
  return file != nullptr;
}

InputError unreadable_file(const std::filesystem::path& path) {
  std::error_code error;
  const auto status = std::filesystem::status(path, error);
  if (status.type() == std::filesystem::file_type::none)  // a name too long, links in a circle
    return {path.string(), "cannot be read: " + error.message(),
            "check the name, the folder and its permissions"};
  if (status.type() == std::filesystem::file_type::not_found)
    return {path.string(), "does not exist", "check the name and the folder"};
  if (std::filesystem::is_directory(status))
    return {path.string(), "is a folder, not a file", "name the file or files in it"};
  if (!can_be_opened(path))
    return {path.string(), std::string("cannot be opened: ") + std::strerror(errno),
            "check its permissions"};
  return {path.string(), "cannot be read", "check its permissions"};
}

}  // namespace malus
