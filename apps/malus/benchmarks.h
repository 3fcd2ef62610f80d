// The registry of `malus bench`: every benchmark reports lines of one table.
#pragma once

#include <chrono>
#include <functional>
#include <string>
#include <vector>

namespace malus::app {

/// One line of the table.
struct BenchmarkLine {
  std::string name;  ///< "physics, 1 thread"
  double value = 0;
  std::string unit;  ///< "Mpx/s", "ms", ...
  std::string note;  ///< sizes, settings; may be empty
};

struct BenchmarkContext {
  bool quick = false;                 ///< a dry run: small data, one repetition
  std::string device = "cpu";         ///< or "cuda", of benchmarks that run there
  std::vector<std::string> networks;  ///< of those that time networks: these only; empty: all
  bool wants_network(const std::string& name) const;
  /// Median time of repeated calls [s], after one that warms up.
  double time_s(const std::function<void()>& work, int repetitions = 9) const;
};

struct Benchmark {
  std::string name;  ///< for --only
  std::function<std::vector<BenchmarkLine>(const BenchmarkContext&)> run;
  /// It times networks: on a GPU too, and chosen ones. Its peers know --device and --network.
  bool of_networks = false;
};

// benchmark_<name>() is defined in cmd_bench_<name>.cpp and returns a Benchmark.
// networks first: opening their module may start the program anew.
#define MALUS_BENCHMARKS(benchmark) \
  benchmark(networks) benchmark(synthesize) benchmark(packed) benchmark(bm3d)

#define MALUS_DECLARE_BENCHMARK(name) Benchmark benchmark_##name();
MALUS_BENCHMARKS(MALUS_DECLARE_BENCHMARK)
#undef MALUS_DECLARE_BENCHMARK

}  // namespace malus::app
