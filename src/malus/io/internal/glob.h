// Names of files from a pattern, in the order in which a person counts.
#pragma once

#include <filesystem>
#include <string>
#include <string_view>
#include <vector>

namespace malus::internal {

/// "f2" before "f10": runs of digits compare as numbers.
bool natural_less(std::string_view a, std::string_view b);

/// Existing paths that match; `pattern` may hold * ? [..] in any part and is relative to folder
/// (whose own characters are taken literally, as are those of the pattern's first folders that
/// exist by that name). A pattern that is itself an existing file gives just that, and so does the
/// name of a stack's frame, stack.tif[3]. Empty when nothing matches.
std::vector<std::filesystem::path> expand_glob(const std::filesystem::path& folder,
                                               const std::string& pattern);

}  // namespace malus::internal
