// bm3d_quality FOLDER [SEED]: the tables of docs/bm3d.md. FOLDER holds grey pictures of 0 to 255
// (Set12). Noise is Gaussian, neither clipped nor rounded; results are not clipped. Times are user
// time on one thread, scaled to 512x512.
#include "malus/base/parallel.h"
#include "malus/base/random.h"
#include "malus/denoise/internal/bm3d_pass.h"
#include "malus/io/picture_file.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <sys/resource.h>

namespace {

using namespace malus;
using internal::Bm3dParameters;

struct Score {
  double psnr_db = 0, milliseconds = 0, predicted_over_actual = 0;
};

double user_time_s() {
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
  return static_cast<double>(usage.ru_utime.tv_sec) +
         1e-6 * static_cast<double>(usage.ru_utime.tv_usec);
}

Score score(const std::vector<Image>& pictures, const Bm3dParameters& parameters, float sigma,
            std::uint64_t seed) {
  Score total;
  double seconds = 0, pixels = 0, predicted = 0, actual = 0;
  for (std::size_t i = 0; i < pictures.size(); ++i) {
    Planes noisy(1, pictures[i].rows(), pictures[i].cols()), variance;
    RandomSequence random(seed, static_cast<std::uint32_t>(i + 1), Draw::kOther);
    for (std::size_t p = 0; p < pictures[i].size(); ++p)
      noisy[0].values()[p] = pictures[i].values()[p] + sigma * static_cast<float>(random.normal());
    const double start = user_time_s();
    const Planes result = internal::bm3d_with(parameters, noisy, std::span(&sigma, 1), {},
                                              silent_progress(), &variance);
    seconds += user_time_s() - start;
    double squares = 0;
    for (std::size_t p = 0; p < pictures[i].size(); ++p) {
      const double d = double{result[0].values()[p]} - double{pictures[i].values()[p]};
      squares += d * d;
      predicted += double{variance[0].values()[p]};
    }
    actual += squares;
    const double count = static_cast<double>(pictures[i].size());
    total.psnr_db += 10 * std::log10(255 * 255 * count / squares);
    pixels += count;
  }
  total.psnr_db /= static_cast<double>(pictures.size());
  total.milliseconds = 1e3 * seconds * 512 * 512 / pixels;
  total.predicted_over_actual = predicted / actual;
  return total;
}

void print_profiles(const std::vector<Image>& pictures, std::uint64_t seed) {
  fmt::print("| sigma | fast | normal | high | predicted / actual squared error, normal |\n");
  fmt::print("|---|---|---|---|---|\n");
  for (const float sigma : {5.0F, 15.0F, 25.0F, 50.0F, 100.0F}) {
    fmt::print("| {} |", sigma);
    double ratio = 0;
    for (const char* name : {"fast", "normal", "high"}) {
      const Score s = score(pictures, internal::bm3d_profile(denoise_profile(name)), sigma, seed);
      if (std::string(name) == "normal") ratio = s.predicted_over_actual;
      fmt::print(" {:.2f} dB, {:.0f} ms |", s.psnr_db, s.milliseconds);
    }
    fmt::print(" {:.2f} |\n", ratio);
    std::fflush(stdout);
  }
}

struct Variation {
  std::string name;
  std::function<void(Bm3dParameters&)> apply;
};

const std::vector<Variation>& variations() {
  static const std::vector<Variation> list = {
      {"normal", [](Bm3dParameters&) {}},
      {"hard pass: step 2", [](Bm3dParameters& p) { p.hard.step = 2; }},
      {"hard pass: step 4", [](Bm3dParameters& p) { p.hard.step = 4; }},
      {"Wiener pass: step 2", [](Bm3dParameters& p) { p.wiener.step = 2; }},
      {"Wiener pass: step 4", [](Bm3dParameters& p) { p.wiener.step = 4; }},
      {"both: range 12", [](Bm3dParameters& p) { p.hard.range = p.wiener.range = 12; }},
      {"both: range 25", [](Bm3dParameters& p) { p.hard.range = p.wiener.range = 25; }},
      {"hard pass: groups of 8", [](Bm3dParameters& p) { p.hard.group = 8; }},
      {"hard pass: groups of 32", [](Bm3dParameters& p) { p.hard.group = 32; }},
      {"Wiener pass: groups of 16", [](Bm3dParameters& p) { p.wiener.group = 16; }},
      {"hard pass: match limit 3", [](Bm3dParameters& p) { p.hard.match_limit = 3; }},
      {"Wiener pass: match limit 0.5", [](Bm3dParameters& p) { p.wiener.match_limit = 0.5F; }},
      {"threshold 2.6", [](Bm3dParameters& p) { p.hard_threshold = 2.6F; }},
      {"threshold 2.7", [](Bm3dParameters& p) { p.hard_threshold = 2.7F; }},
      {"threshold 2.9", [](Bm3dParameters& p) { p.hard_threshold = 2.9F; }},
  };
  return list;
}

void print_variations(const std::vector<Image>& pictures, std::uint64_t seed) {
  fmt::print("\n| normal, but | sigma 25 | sigma 50 | ms |\n|---|---|---|---|\n");
  for (const auto& variation : variations()) {
    Bm3dParameters parameters = internal::bm3d_profile(DenoiseProfile::kNormal);
    variation.apply(parameters);
    const Score low = score(pictures, parameters, 25, seed);
    const Score high = score(pictures, parameters, 50, seed);
    fmt::print("| {} | {:.3f} | {:.3f} | {:.0f} |\n", variation.name, low.psnr_db, high.psnr_db,
               0.5 * (low.milliseconds + high.milliseconds));
    std::fflush(stdout);
  }
}

void run(const std::filesystem::path& folder, std::uint64_t seed) {
  set_thread_count(1);
  std::vector<std::filesystem::path> files;
  for (const auto& entry : std::filesystem::directory_iterator(folder))
    if (entry.path().extension() == ".png") files.push_back(entry.path());
  std::sort(files.begin(), files.end());
  std::vector<Image> pictures;
  for (const auto& file : files) pictures.push_back(load_picture(file).planes[0]);
  print_profiles(pictures, seed);
  print_variations(pictures, seed);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 2) {
    std::fputs("usage: bm3d_quality FOLDER [SEED]\n", stderr);
    return 2;
  }
  try {
    run(argv[1], argc > 2 ? std::stoull(argv[2]) : 1);
  } catch (const std::exception& error) {
    fmt::print(stderr, "{}\n", error.what());
    return 1;
  }
}
