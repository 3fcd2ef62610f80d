#include "program_start.h"

#include <csignal>
#include <system_error>

#include <fcntl.h>
#include <sys/auxv.h>
#include <unistd.h>

namespace malus::app {
namespace {

namespace fs = std::filesystem;

ProgramStart g_start;

fs::path own_file() {
  std::error_code error;
  if (const fs::path file = fs::read_symlink("/proc/self/exe", error); !error) return file;
  // What the kernel was asked to run, from the folder of the start.
  const auto* asked = reinterpret_cast<const char*>(getauxval(AT_EXECFN));
  return asked == nullptr ? fs::path() : fs::weakly_canonical(fs::absolute(asked, error), error);
}

}  // namespace

void remember_start(int argc, char** argv) { g_start = {own_file(), {argv, argv + argc}}; }

void keep_closed_streams_closed() {
  // Opened for the wrong direction: reading and writing fail as before.
  for (const int stream : {STDIN_FILENO, STDOUT_FILENO, STDERR_FILENO})
    if (fcntl(stream, F_GETFD) == -1)
      if (open("/dev/null", stream == STDIN_FILENO ? O_WRONLY : O_RDONLY) == -1) return;
}

void report_full_files() { std::signal(SIGXFSZ, SIG_IGN); }

const ProgramStart& program_start() { return g_start; }

}  // namespace malus::app
