// Runs a fuzz target over its seed corpus and over truncations and byte flips of every seed: what a
// fuzzer found once, and the nearest neighbours of every seed, stay mended without a fuzzer.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace {

void replay_neighbours(const std::vector<char>& seed) {
  const auto run = [](const std::vector<char>& bytes) {
    LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size());
  };
  run(seed);
  constexpr std::size_t kTries = 128;
  const std::size_t step = seed.size() / kTries + 1;
  for (std::size_t i = 0; i < seed.size(); i += step) {
    run(std::vector<char>(seed.begin(), seed.begin() + static_cast<std::ptrdiff_t>(i)));
    std::vector<char> flipped = seed;
    flipped[i] = static_cast<char>(flipped[i] ^ (1 << (i % 8)));
    run(flipped);
    flipped[i] = static_cast<char>(0xff);
    run(flipped);
  }
}

}  // namespace

int main(int argc, char** argv) {
  int seeds = 0;
  for (int i = 1; i < argc; ++i)
    for (const auto& entry : std::filesystem::directory_iterator(argv[i])) {
      std::ifstream file(entry.path(), std::ios::binary);
      replay_neighbours({std::istreambuf_iterator<char>(file), {}});
      ++seeds;
    }
  std::printf("%d seeds replayed\n", seeds);
  return seeds > 0 ? 0 : 1;
}
