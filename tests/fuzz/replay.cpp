// Runs a fuzz target over its seed corpus and over truncations and byte flips of every seed: what a
// fuzzer found once, and the nearest neighbours of every seed, stay mended without a fuzzer. Seeds
// named bad_* must be refused, all others accepted: so it is known that the target reaches the
// parser.
#include "malus/base/error.h"

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "target.h"

namespace {

bool accepted(const std::vector<char>& bytes) {
  try {
    parse_bytes({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
    return true;
  } catch (const malus::InputError&) {
    return false;
  }
}

void replay_neighbours(const std::vector<char>& seed) {
  constexpr std::size_t kTries = 128;
  const std::size_t step = seed.size() / kTries + 1;
  for (std::size_t i = 0; i < seed.size(); i += step) {
    accepted(std::vector<char>(seed.begin(), seed.begin() + static_cast<std::ptrdiff_t>(i)));
    std::vector<char> flipped = seed;
    flipped[i] = static_cast<char>(flipped[i] ^ (1 << (i % 8)));
    accepted(flipped);
    flipped[i] = static_cast<char>(0xff);
    accepted(flipped);
  }
}

}  // namespace

int main(int argc, char** argv) {
  int seeds = 0, wrong = 0;
  for (int i = 1; i < argc; ++i)
    for (const auto& entry : std::filesystem::directory_iterator(argv[i])) {
      std::ifstream file(entry.path(), std::ios::binary);
      const std::vector<char> seed{std::istreambuf_iterator<char>(file), {}};
      const bool bad = entry.path().filename().string().starts_with("bad_");
      if (accepted(seed) == bad) {
        std::printf("%s was %s\n", entry.path().c_str(), bad ? "accepted" : "refused");
        ++wrong;
      }
      replay_neighbours(seed);
      ++seeds;
    }
  std::printf("%d seeds replayed, %d not taken as their names say\n", seeds, wrong);
  return seeds > 0 && wrong == 0 ? 0 : 1;
}
