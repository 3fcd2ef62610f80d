// How this program was started: where its file lies and with which arguments, kept by main for what
// looks beside the program or starts it anew. Works without /proc too.
#pragma once

#include <filesystem>
#include <string>
#include <vector>

namespace malus::app {

struct ProgramStart {
  std::filesystem::path file;  ///< absolute, links resolved
  std::vector<std::string> arguments;
};

/// main's first deed.
void remember_start(int argc, char** argv);
const ProgramStart& program_start();

/// Takes the places of standard streams that are closed (`2>&-`), so that no file that is opened
/// later is given one: what the program says would be written into it.
void keep_closed_streams_closed();

/// A file that grows beyond what `ulimit -f` allows fails to be written, as on a full disk, instead
/// of ending the program (SIGXFSZ).
void report_full_files();

}  // namespace malus::app
