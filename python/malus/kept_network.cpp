#include "kept_network.h"

#include <filesystem>
#include <system_error>

#include "networks_door.h"
#include "settings.h"

namespace malus::python {
namespace {

struct Kept {
  std::vector<std::string> key;
  std::shared_ptr<SharedDenoiser> denoiser;
};

// Never destroyed: libtorch's own ends in an order that nobody knows.
Kept* g_kept = new Kept;

// What a file is known by; of one that cannot be looked at, only its name.
std::vector<std::string> identity_of(const std::filesystem::path& file) {
  std::error_code unknown;
  const auto written = std::filesystem::last_write_time(file, unknown).time_since_epoch().count();
  return {std::filesystem::absolute(file, unknown).string(),
          std::to_string(std::filesystem::file_size(file, unknown)), std::to_string(written)};
}

}  // namespace

std::shared_ptr<SharedDenoiser> denoiser_for(const DenoiseKeywords& keywords, bool variance) {
  const auto open = [&] {
    const pybind11::gil_scoped_release release;
    return std::make_shared<SharedDenoiser>(keywords, variance);
  };
  if (!app::is_weight_file(keywords.filter.method)) return open();
  std::vector<std::string> key = values_of(keywords);
  key.push_back(variance ? "variance" : "");
  for (std::string& part : identity_of(keywords.filter.method)) key.push_back(std::move(part));
  if (g_kept->denoiser && g_kept->key == key) {
    app::networks();  // shares with the module what has changed since
    return g_kept->denoiser;
  }
  g_kept->denoiser.reset();  // before the other needs its memory
  auto opened = open();
  *g_kept = {std::move(key), opened};
  return opened;
}

void forget_networks() { g_kept = new Kept; }

}  // namespace malus::python
