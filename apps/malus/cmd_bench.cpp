// malus bench: how fast this machine runs malus, and, with --peers, what others do on it in the
// same run.
#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/stopwatch.h"

#include <algorithm>
#include <array>
#include <cstdio>
#include <filesystem>
#include <memory>

#include "benchmarks.h"
#include "flags.h"
#include "program.h"
#include <fmt/format.h>

namespace malus::app {

double BenchmarkContext::time_s(const std::function<void()>& work, int repetitions) const {
  if (!quick) work();
  std::vector<double> times;
  for (int i = 0; i < (quick ? 1 : repetitions); ++i) {
    const Stopwatch stopwatch;
    work();
    times.push_back(stopwatch.seconds());
  }
  std::nth_element(times.begin(), times.begin() + static_cast<std::ptrdiff_t>(times.size() / 2),
                   times.end());
  return times[times.size() / 2];
}

bool BenchmarkContext::wants_network(const std::string& name) const {
  return networks.empty() || std::find(networks.begin(), networks.end(), name) != networks.end();
}

namespace {

using Json = nlohmann::ordered_json;
namespace fs = std::filesystem;

struct BenchArguments {
  std::vector<std::string> only, networks;
  bool quick = false;
  fs::path peers;
  std::string python = "python3", device = "cpu";
};

// What a program prints; InputError when it cannot be started or fails.
std::string output_of(const std::string& command) {
  std::FILE* pipe = popen(command.c_str(), "r");
  if (pipe == nullptr)
    throw InputError(command, "cannot be started", "check that the interpreter is installed");
  std::string text;
  std::array<char, 4096> buffer{};
  while (const std::size_t got = std::fread(buffer.data(), 1, buffer.size(), pipe))
    text.append(buffer.data(), got);
  if (pclose(pipe) != 0) throw InputError(command, "failed", "run it by hand to see why");
  return text;
}

std::string quoted(const std::string& text) {
  std::string out = "'";
  for (const char c : text) out += c == '\'' ? std::string("'\\''") : std::string(1, c);
  return out + "'";
}

// How many times as fast as a peer our lines are whose names begin with `compared`.
void add_ratios(const BenchmarkLine& peer, const std::string& compared,
                const std::vector<BenchmarkLine>& ours, std::vector<BenchmarkLine>& lines) {
  for (const BenchmarkLine& own : ours)
    if (own.name.starts_with(compared) && own.value > 0 && peer.value > 0) {
      const double times_as_long = peer.value / own.value;
      const double ratio = peer.unit.ends_with("/s") ? 1 / times_as_long : times_as_long;
      lines.push_back({own.name + ", ratio", ratio, "", peer.name});
    }
}

// Every script prints one JSON list of lines, [{"name", "value", "unit", "note"}]; empty where what
// it compares with is not installed. A line may say which of ours it is "compared" with.
std::vector<BenchmarkLine> run_peer(const BenchArguments& arguments, const fs::path& script,
                                    const std::vector<BenchmarkLine>& ours) {
  std::string command =
      fmt::format("{} {}{}{}", quoted(arguments.python), quoted(script.string()),
                  arguments.quick ? " --quick" : "",
                  arguments.device == "cpu" ? "" : " --device " + arguments.device);
  for (const std::string& network : arguments.networks) command += " --network " + quoted(network);
  const Json json = Json::parse(output_of(command), nullptr, false);
  if (!json.is_array())
    throw InputError(script.string(), "prints no JSON list", "run it by hand to see why");
  std::vector<BenchmarkLine> lines;
  try {
    for (const Json& line : json) {
      const BenchmarkLine peer{line.value("name", script.stem().string()), line.value("value", 0.0),
                               line.value("unit", ""), line.value("note", "")};
      lines.push_back(peer);
      if (line.contains("compared")) add_ratios(peer, line.value("compared", ""), ours, lines);
    }
  } catch (const Json::exception& error) {
    throw InputError(script.string(),
                     fmt::format("its JSON list holds no lines of results ({})", error.what()),
                     "run it by hand to see why");
  }
  return lines;
}

std::vector<fs::path> peer_scripts(const fs::path& folder) {
  std::vector<fs::path> scripts;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error))
    if (entry.path().extension() == ".py") scripts.push_back(entry.path());
  if (scripts.empty())
    throw InputError(folder.string(), "holds no scripts", "give the folder bench/peers");
  std::sort(scripts.begin(), scripts.end());
  return scripts;
}

void report(const std::string& name, const std::vector<BenchmarkLine>& lines, Json& json,
            std::string& text) {
  Json list = Json::array();
  text += fmt::format("{}\n", name);
  for (const BenchmarkLine& line : lines) {
    list.push_back(
        {{"name", line.name}, {"value", line.value}, {"unit", line.unit}, {"note", line.note}});
    text +=
        fmt::format("  {:<44} {:>10.4g} {:<8} {}\n", line.name, line.value, line.unit, line.note);
  }
  json[name] = list;
}

void run_bench(const BenchArguments& arguments, const Common& common,
               const std::vector<Benchmark>& all) {
  const BenchmarkContext context{arguments.quick, arguments.device, arguments.networks};
  Json json{{"threads", thread_count()}, {"quick", arguments.quick}};
  std::string text;
  const auto scripts =
      arguments.peers.empty() ? std::vector<fs::path>() : peer_scripts(arguments.peers);
  for (const Benchmark& benchmark : all) {
    const auto wanted = [&] {
      return arguments.only.empty() || std::find(arguments.only.begin(), arguments.only.end(),
                                                 benchmark.name) != arguments.only.end();
    };
    if (!wanted()) continue;
    if (!benchmark.of_networks && (arguments.device != "cpu" || !arguments.networks.empty()))
      throw CLI::ValidationError(
          arguments.device != "cpu" ? "--device " + arguments.device : "--network",
          benchmark.name + " times no networks; add --only networks");
    note(common, fmt::format("running {} ...", benchmark.name));
    const auto ours = benchmark.run(context);
    auto lines = ours;
    // A peer's script is named after the benchmark that it answers: synthesize_numpy.py.
    for (const fs::path& script : scripts)
      if (script.stem().string().rfind(benchmark.name + "_", 0) == 0)
        for (auto& line : run_peer(arguments, script, ours)) lines.push_back(std::move(line));
    report(benchmark.name, lines, json, text);
  }
  print_result(common, json, text);
}

}  // namespace

void add_bench(CLI::App& app, Common& common) {
  const auto arguments = std::make_shared<BenchArguments>();
  const auto all = std::make_shared<std::vector<Benchmark>>();
#define MALUS_ADD_BENCHMARK(name) all->push_back(benchmark_##name());
  MALUS_BENCHMARKS(MALUS_ADD_BENCHMARK)
#undef MALUS_ADD_BENCHMARK
  std::vector<std::string> names;
  for (const Benchmark& benchmark : *all) names.push_back(benchmark.name);
  CLI::App* command =
      add_command(app, common, "bench", "The speed table of this machine", {},
                  [arguments, &common, all] { run_bench(*arguments, common, *all); });
  command->add_option("--only", arguments->only, "these benchmarks")->check(one_of(names));
  command->add_flag("--quick", arguments->quick, "a dry run: small data, once");
  command->add_option("--peers", arguments->peers,
                      "folder of scripts (bench/peers) that run other software on the same task");
  command->add_option("--python", arguments->python, "interpreter of the scripts")
      ->capture_default_str();
  command
      ->add_option("--device", arguments->device,
                   "where the networks run; cuda: images per second of inference and training")
      ->check(one_of({"cpu", "cuda"}))
      ->capture_default_str();
  command->add_option("--network", arguments->networks, "of the networks these, by name");
}

}  // namespace malus::app
