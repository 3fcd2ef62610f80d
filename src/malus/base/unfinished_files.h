// Files under construction: hidden beside their final name, which tells who writes them, so that a
// later run can clear away what a killed one left without touching what a living one writes.
#pragma once

#include <filesystem>
#include <functional>
#include <string_view>

namespace malus {

/// A new name beside path, with its ending: ".WHERE-PROCESS-NUMBER-NAME". WHERE stands for this
/// machine since it was started, and its space of process numbers.
std::filesystem::path unfinished_name(const std::filesystem::path& path);

/// Removes from folder the unfinished files with a wanted final name whose writers are no more:
/// processes of WHERE that have ended, and writers elsewhere that have not written for a day (two
/// machines may share a folder, and only the file's age speaks for the other's). A missing folder
/// holds none. Returns how many were removed.
int remove_unfinished(const std::filesystem::path& folder,
                      const std::function<bool(std::string_view name)>& wanted);

/// Removes the unfinished files whose final name is path's and whose writers, processes of WHERE,
/// have ended. Of others nothing is said by their age: the folder may be anybody's. What lies in a
/// folder is read when a file of it is first asked for, and not again: a run may write ten
/// thousand.
void remove_unfinished_of(const std::filesystem::path& path);

}  // namespace malus
