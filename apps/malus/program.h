// What all commands share: common flags, output conventions, progress on a terminal, exit codes
// (docs/commands.md says them to users).
#pragma once

#include "malus/base/progress.h"

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

namespace malus::app {

struct Common {
  bool json = false;                  ///< one JSON object on stdout, nothing else there
  bool quiet = false;                 ///< no progress, no notes; warnings and errors stay
  bool force = false;                 ///< existing outputs may be replaced
  int threads = 0;                    ///< 0 = all cores
  std::uint64_t seed = 0;             ///< 0 is a seed like any other
  std::vector<std::string> settings;  ///< --set of commands that train
};

/// The program without its commands: name, --version, the layout of --help.
std::unique_ptr<CLI::App> make_program();

/// Which of the common flags mean something to a command; of the others it says that they are none
/// of its own.
struct Takes {
  bool seed = false;   ///< it draws random numbers
  bool force = false;  ///< it writes files
};

/// Adds a command with the common flags; run is called after parsing, with threads set.
CLI::App* add_command(CLI::App& app, Common& common, const std::string& name,
                      const std::string& description, const Takes& takes,
                      std::function<void()> run);

/// --set, for a command that trains networks.
void add_training_settings(CLI::App& command, Common& common);

/// JSON as text; indent as nlohmann::json::dump. Names of files may be no UTF-8, which JSON cannot
/// hold: such bytes are replaced, never a reason to fail.
std::string json_utf8(const nlohmann::ordered_json& json, int indent);

/// Results: the JSON object under --json, else the text. Both go to stdout.
void print_result(const Common& common, const nlohmann::ordered_json& json, std::string_view text);
/// Results of a command that takes frames one by one: of one frame its object, of several a list
/// "frames" of those that were finished; nothing where none was.
void print_frames(const Common& common, const nlohmann::ordered_json& finished, std::size_t inputs,
                  std::string_view text);
/// A line for people on stderr; silent under -q.
void note(const Common& common, std::string_view line);
/// A warning on stderr, always.
void warn(std::string_view text);
/// A warning about a file. The same of further files is counted, and said once more when the
/// command ends; of the same file it is said once.
void warn_of(const std::string& file, const std::string& text);
/// The lines of warn and warn_of since the last call, each once; those that warn_of only counted
/// are among them. For what a run writes about itself: its record, its report.
std::vector<std::string> take_warnings();
/// Text on stderr as it is. Where that cannot be written, it is lost and the work goes on.
void tell(std::string_view text);

/// Progress bar with time left on stderr when that is a terminal; Ctrl-C requests a stop.
std::unique_ptr<Progress> make_progress(const Common& common);

/// work(), then print(), also where an error or Ctrl-C ends the work: what was finished before lies
/// on the disk, and this says which.
template <class Work, class Print>
void work_and_print(const Work& work, const Print& print) {
  try {
    work();
  } catch (...) {
    print();
    throw;
  }
  print();
}

/// Runs the parsed program; returns the exit code: 0 done, 1 input or environment at fault, 2 wrong
/// usage (flags that do not go together, and a value that no file could make right), 130 stopped.
/// By Ctrl-C it does not return: the process ends by SIGINT, which a shell calls 130.
int run_program(CLI::App& app, int argc, char** argv);

}  // namespace malus::app
