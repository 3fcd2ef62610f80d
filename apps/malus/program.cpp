#include "program.h"

#include "malus/base/error.h"
#include "malus/base/one_line.h"
#include "malus/base/parallel.h"
#include "malus/base/text.h"
#include "malus/io/config_section.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <limits>
#include <mutex>
#include <new>
#include <set>
#include <system_error>
#include <vector>

#include "argument_lists.h"
#include "flags.h"
#include "live_progress.h"
#include <fmt/format.h>
#include <sys/ioctl.h>
#include <unistd.h>

namespace malus::app {
namespace {

constexpr int kExitInput = 1, kExitUsage = 2, kExitStopped = 130;

// The signal that asks for a stop, 0 before. Set by a signal handler and read by the workers: a
// lock-free atomic alone may serve both.
std::atomic<int> g_stop_signal = 0;
static_assert(std::atomic<int>::is_always_lock_free);

// What warn_of said, of which files; in its order.
struct SaidOfFiles {
  std::string text;
  std::set<std::string> files;
};
std::vector<SaidOfFiles> g_said;

// Lines for take_warnings. Workers warn, too.
std::mutex g_warnings_mutex;
std::vector<std::string> g_warnings;

void keep_warning(const std::string& line) {
  const std::lock_guard lock(g_warnings_mutex);
  if (std::ranges::find(g_warnings, line) == g_warnings.end()) g_warnings.push_back(line);
}

void print_warning(const std::string& line) { tell(fmt::format("warning: {}\n", line)); }

void say_how_often() {
  for (const SaidOfFiles& said : g_said)
    if (const std::size_t more = said.files.size() - 1; more > 0)
      print_warning(
          fmt::format("also of {}: {}", counted(std::int64_t(more), "more file"), said.text));
}

// The second Ctrl-C ends the program at once.
void request_stop(int signal) {
  g_stop_signal = signal;
  std::signal(signal, SIG_DFL);
}

// After Ctrl-C a shell ends its loop only where the program died of the signal; it calls that 130,
// too. SIGTERM is for this program alone.
int end_as_stopped() {
  if (g_stop_signal == SIGINT) {
    std::fflush(nullptr);
    std::signal(SIGINT, SIG_DFL);
    std::raise(SIGINT);
  }
  return kExitStopped;
}

class TerminalProgress final : public Progress {
 public:
  TerminalProgress(const Common& common, std::shared_ptr<const Remark> remark)
      : quiet_(common.quiet),
        visible_(!common.quiet && isatty(STDERR_FILENO) == 1),
        remark_(std::move(remark)) {}
  ~TerminalProgress() override { erase(); }

  void begin(std::string_view stage, std::int64_t total) override {
    const std::lock_guard lock(mutex_);
    erase();
    stage_ = stage;
    total_ = total;
    done_ = 0;
    start_ = last_ = Clock::now();
  }
  void advance(std::int64_t steps) override {
    const std::lock_guard lock(mutex_);
    done_ += steps;
    const auto now = Clock::now();
    if (!visible_ || now - last_ < std::chrono::milliseconds(100)) return;
    last_ = now;
    draw(std::chrono::duration<double>(now - start_).count());
  }
  void warn(std::string_view message) override {
    const std::lock_guard lock(mutex_);
    erase();
    app::warn(message);
  }
  void warn_of(std::string_view file, std::string_view message) override {
    const std::lock_guard lock(mutex_);
    erase();
    app::warn_of(std::string(file), std::string(message));
  }
  void note(std::string_view message) override {
    if (quiet_) return;
    const std::lock_guard lock(mutex_);
    erase();
    tell(fmt::format("{}\n", message));
  }
  bool stop_requested() const override { return g_stop_signal != 0; }

 private:
  using Clock = std::chrono::steady_clock;

  void draw(double elapsed_s) {
    const double part =
        total_ > 0 ? std::min(1.0, static_cast<double>(done_) / static_cast<double>(total_)) : 0.0;
    const double left_s = part > 0 ? elapsed_s * (1.0 - part) / part : 0.0;
    const std::string remark = remark_ ? remark_->text() : "";
    const int width = remark.empty() ? 28 : 12;
    std::string bar(static_cast<std::size_t>(part * width), '#');
    bar.resize(static_cast<std::size_t>(width), '.');
    std::string line = fmt::format("{} [{}] {:3.0f} %  {:.0f} s left  {}", stage_, bar, 100 * part,
                                   left_s, remark);
    // A line that wraps could not be drawn over.
    winsize terminal{};
    if (ioctl(STDERR_FILENO, TIOCGWINSZ, &terminal) == 0 && terminal.ws_col > 0)
      line.resize(std::min<std::size_t>(line.size(), terminal.ws_col - 1u));
    tell(fmt::format("\r{}\033[K", line));
    drawn_ = true;
  }
  void erase() {
    if (drawn_) tell("\r\033[K");
    drawn_ = false;
  }

  bool quiet_, visible_, drawn_ = false;
  std::shared_ptr<const Remark> remark_;
  std::mutex mutex_;
  std::string stage_;
  std::int64_t total_ = 0, done_ = 0;
  Clock::time_point start_, last_;
};

// CLI11 writes "--row,--no-row{false}".
class HelpLayout final : public CLI::Formatter {
 public:
  std::string make_option_name(const CLI::Option* option, bool positional) const override {
    std::string name = CLI::Formatter::make_option_name(option, positional);
    constexpr std::string_view kNegated = "{false}";
    for (std::size_t at = 0; (at = name.find(kNegated, at)) != std::string::npos;)
      name.erase(at, kNegated.size());
    return name;
  }
};

// As typed after the program: "model list".
std::string words_of(const CLI::App& command) {
  const CLI::App* parent = command.get_parent();
  if (parent == nullptr) return {};
  const std::string before = words_of(*parent);
  return before.empty() ? command.get_name() : before + " " + command.get_name();
}

// Empty where all flags are the command's.
std::string unknown_flag(const CLI::App& command) {
  std::vector<std::string> flags;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) flags.push_back("--" + name);
  for (const std::string& word : command.remaining()) {
    if (!word.starts_with('-') || word == "-") continue;
    const std::string flag = word.substr(0, word.find('='));
    const std::string words = words_of(command);
    std::error_code unknown;
    if (std::filesystem::exists(word, unknown))
      return fmt::format("{}: is taken for a flag; write ./{} to name the file", word, word);
    return fmt::format("{}: is no flag of {}; {}`malus {} --help` shows all", flag, words,
                       did_you_mean(flag, flags), words);
  }
  return {};
}

// CLI11's words for values that are missing, or more than one: "--gain: At Most 1 required but
// received 2", "--gain: 1 required FLOAT missing".
std::string plain_words(const std::string& said) {
  constexpr std::string_view kTwice = ": At Most 1 required but received ", kNone = ": 1 required ";
  if (const auto at = said.find(kTwice); at != std::string::npos)
    return fmt::format("{}: is given {} times; give it once", said.substr(0, at),
                       said.substr(at + kTwice.size()));
  if (const auto at = said.find(kNone); at != std::string::npos && said.ends_with(" missing"))
    return said.substr(0, at) + ": has no value; give one after it";
  return said;
}

// CLI11 says no more than that a subcommand is missing, also where a word was meant to be one, and
// what it did not expect.
std::string usage_problem(const CLI::App& program, const CLI::ParseError& error) {
  const CLI::App* at = &program;
  while (!at->get_subcommands().empty()) at = at->get_subcommands().front();
  if (at != &program)
    if (const std::string problem = unknown_flag(*at); !problem.empty()) return problem;
  std::vector<std::string> commands;
  for (const CLI::App* command : at->get_subcommands([](const CLI::App*) { return true; }))
    commands.push_back(command->get_name());
  if (commands.empty() || dynamic_cast<const CLI::RequiredError*>(&error) == nullptr)
    return plain_words(error.what()) +
           (dynamic_cast<const CLI::RequiredError*>(&error) ? taken_by_lists(*at) : "");
  const auto words = at->remaining();
  if (words.empty()) return "a command is missing; there are " + joined(commands);
  return fmt::format("{}: is no command; {}there are {}", words.front(),
                     did_you_mean(words.front(), commands), joined(commands));
}

// `malus help denoise` is `malus denoise --help`.
std::vector<std::string> with_help_as_flag(std::vector<std::string> words) {
  if (words.empty() || words.front() != "help") return words;
  words.erase(words.begin());
  words.push_back("--help");
  return words;
}

// An empty value is what a shell makes of a variable that is not set. Taken as a path it would be
// the current folder, or the same as no flag at all.
void refuse_empty_values(const CLI::App& command) {
  for (const CLI::Option* option : command.get_options())
    for (const std::string& value : option->results())
      if (value.empty())
        throw CLI::ValidationError(
            option->get_name(),
            "is given without a value, an empty text; name one, or leave it out");
}

}  // namespace

std::unique_ptr<CLI::App> make_program() {
  auto app =
      std::make_unique<CLI::App>("Measure a camera's noise, imitate it and remove it", "malus");
  app->formatter(std::make_shared<HelpLayout>());
  app->set_version_flag("--version", MALUS_VERSION);
  app->require_subcommand(1);
  return app;
}

CLI::App* add_command(CLI::App& app, Common& common, const std::string& name,
                      const std::string& description, const Takes& takes,
                      std::function<void()> run) {
  CLI::App* command = app.add_subcommand(name, description);
  command->add_flag("--json", common.json, "print one JSON object on stdout");
  command->add_flag("-q,--quiet", common.quiet, "no progress and no notes");
  if (takes.force) command->add_flag("--force", common.force, "replace existing outputs");
  command->add_option("--threads", common.threads, "number of threads; 0 = all cores")
      ->check(in_range(0, 1024));
  if (takes.seed)
    command->add_option("--seed", common.seed, "seed of all random numbers")
        ->check(counting_number(std::numeric_limits<std::uint64_t>::max()))
        ->capture_default_str();
  command->callback([&common, command, run = std::move(run)] {
    refuse_empty_values(*command);
    set_thread_count(common.threads);
    run();
  });
  return command;
}

void add_training_settings(CLI::App& command, Common& common) {
  command
      .add_option("--set", common.settings,
                  "SECTION.KEY=VALUE in place of what a training's configuration says, e.g. "
                  "train.steps=5000; once per setting")
      ->check(accepted_by(require_setting_text))
      ->allow_extra_args(false);
}

std::string json_utf8(const nlohmann::ordered_json& json, int indent) {
  return json.dump(indent, ' ', false, nlohmann::ordered_json::error_handler_t::replace);
}

void print_result(const Common& common, const nlohmann::ordered_json& json, std::string_view text) {
  const std::string out = common.json ? json_utf8(json, 2) : std::string(text);
  // A write that fails empties the buffer: the flush after it has nothing left to fail at.
  bool whole = std::fwrite(out.data(), 1, out.size(), stdout) == out.size();
  if (!out.empty() && out.back() != '\n') whole = std::fputc('\n', stdout) != EOF && whole;
  whole = std::fflush(stdout) == 0 && whole;
  if (!whole || std::ferror(stdout) != 0)
    throw InputError("standard output", "cannot be written",
                     "check the disk or the pipe it goes to");
}

void print_frames(const Common& common, const nlohmann::ordered_json& finished, std::size_t inputs,
                  std::string_view text) {
  if (finished.empty()) return;
  print_result(common, inputs == 1 ? finished[0] : nlohmann::ordered_json{{"frames", finished}},
               text);
}

void note(const Common& common, std::string_view line) {
  if (!common.quiet) tell(fmt::format("{}\n", line));
}

void warn(std::string_view text) {
  const std::string line = one_line(text);
  keep_warning(line);
  print_warning(line);
}

void warn_of(const std::string& file, const std::string& text) {
  const std::string words = one_line(text), line = fmt::format("{}: {}", one_line(file), words);
  keep_warning(line);
  const auto said = std::ranges::find(g_said, words, &SaidOfFiles::text);
  if (said != g_said.end()) {
    said->files.insert(file);
    return;
  }
  g_said.push_back({words, {file}});
  print_warning(line);
}

std::vector<std::string> take_warnings() {
  const std::lock_guard lock(g_warnings_mutex);
  return std::exchange(g_warnings, {});
}

// fmt::print would throw where nothing can be written.
void tell(std::string_view text) {
  std::fwrite(text.data(), 1, text.size(), stderr);
  std::fflush(stderr);
}

std::unique_ptr<Progress> make_progress(const Common& common) {
  return make_live_progress(common, nullptr);
}

std::unique_ptr<Progress> make_live_progress(const Common& common,
                                             std::shared_ptr<const Remark> remark) {
  std::signal(SIGINT, request_stop);
  std::signal(SIGTERM, request_stop);
  return std::make_unique<TerminalProgress>(common, std::move(remark));
}

int run_program(CLI::App& app, int argc, char** argv) {
  try {
    std::vector<std::string> arguments =
        with_lists_ended(app, with_help_as_flag({argv + 1, argv + argc}));
    std::ranges::reverse(arguments);  // as the parser takes them
    app.parse(std::move(arguments));
    say_how_often();
    return 0;
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return app.exit(error);  // --help, --version
    tell(fmt::format("malus: {}\nRun with --help for usage.\n", usage_problem(app, error)));
    return kExitUsage;
  } catch (const InputError& error) {
    tell(fmt::format("malus: {}\n", error.what()));
    return kExitInput;
  } catch (const Cancelled&) {
    tell("malus: stopped on request; finished outputs are whole, none is half-written\n");
    return end_as_stopped();
  } catch (const std::filesystem::filesystem_error& error) {
    tell(fmt::format("malus: {}: {}; check the name, the folder and its permissions\n",
                     error.path1().string(), error.code().message()));
    return kExitInput;
  } catch (const std::system_error& error) {  // threads that the system refuses
    tell(fmt::format("malus: the system: {}; check the rights and the limits of your account\n",
                     error.what()));
    return kExitInput;
  } catch (const std::bad_alloc&) {
    tell(
        "malus: memory: not enough for this input; lower --memory or --threads, or crop the "
        "input\n");
    return kExitInput;
  }
}

}  // namespace malus::app
