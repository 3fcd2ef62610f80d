#include "malus/neural/network.h"

#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/neural/internal/network_size.h"
#include "malus/neural/named_source.h"
#include "malus/neural/networks.h"

#include <cstring>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;

struct Architecture {
  const char* name;
  std::shared_ptr<Network> (*make)(const Json&);
  Json defaults;  ///< published sizes with 16 channels in and out
};

const std::vector<Architecture>& registry() {
  static const std::vector<Architecture> architectures = {
      {"unet",
       make_unet,
       {{"in_channels", 16}, {"out_channels", 16}, {"width", 32}, {"levels", 5}, {"upscale", 1}}},
      {"nafnet",
       make_nafnet,
       {{"img_channel", 16},
        {"width", 32},
        {"middle_blk_num", 12},
        {"enc_blk_nums", {2, 2, 4, 8}},
        {"dec_blk_nums", {2, 2, 2, 2}}}},
      {"restormer",
       make_restormer,
       {{"inp_channels", 16},
        {"out_channels", 16},
        {"dim", 48},
        {"num_blocks", {4, 6, 6, 8}},
        {"num_refinement_blocks", 4},
        {"heads", {1, 2, 4, 8}},
        {"ffn_expansion_factor", 2.66},
        {"bias", false},
        {"LayerNorm_type", "BiasFree"}}},
      {"uformer",
       make_uformer,
       {{"img_size", 128},
        {"in_chans", 16},
        {"dd_in", 16},
        {"embed_dim", 32},
        {"depths", {2, 2, 2, 2, 2, 2, 2, 2, 2}},
        {"num_heads", {1, 2, 4, 8, 16, 16, 8, 4, 2}},
        {"win_size", 8},
        {"token_projection", "linear"},
        {"token_mlp", "leff"},
        {"modulator", true}}},
      {"malus",
       make_hybrid,
       {{"in_channels", 16},
        {"out_channels", 16},
        {"dim", 32},
        {"depths", {2, 2, 2, 2}},
        {"heads", {1, 2, 4, 8}},
        {"window", 8}}},
  };
  return architectures;
}

const Architecture& find_architecture(const std::string& name) {
  for (const auto& architecture : registry())
    if (name == architecture.name) return architecture;
  const auto names = network_names();
  throw InputError(fmt::format("network \"{}\"", name), "is no known architecture",
                   did_you_mean(name, names) + "known: " + joined(names));
}

// Defaults overridden by the given settings; every override must exist and be of the default's kind
// and length class.
Json merged(const Architecture& architecture, const Json& settings) {
  Json all = architecture.defaults;
  if (!settings.is_null() && !settings.is_object())
    throw InputError(fmt::format("settings of {}", architecture.name), "not a table",
                     "give names and values");
  for (const auto& [key, value] : settings.items()) {
    std::vector<std::string> known;
    for (const auto& [name, unused] : all.items()) known.push_back(name);
    if (!all.contains(key))
      throw InputError(fmt::format("settings of {}", architecture.name),
                       fmt::format("unknown setting \"{}\"", key),
                       did_you_mean(key, known) + "known: " + joined(known));
    const bool same_kind =
        all[key].is_number() ? value.is_number() : all[key].type() == value.type();
    if (!same_kind)
      throw InputError(fmt::format("settings of {}", architecture.name),
                       fmt::format("\"{}\" is {}", key, value.dump()),
                       fmt::format("give a value like {}", all[key].dump()));
    all[key] = value;
  }
  return all;
}

// 2 GiB of float32, ten times the largest published network.
constexpr double kMostValues = 1 << 29;

// Of values: 85,536, and 12 million where nobody would count.
std::string count_text(double count) {
  constexpr double kMillion = 1e6;
  if (count >= 10 * kMillion && count < 1e15)
    return fmt::format("{:.0f} million", count / kMillion);
  if (count >= 10 * kMillion) return fmt::format("{:.1e}", count);
  std::string digits = fmt::format("{:.0f}", count);
  for (auto at = static_cast<std::ptrdiff_t>(digits.size()) - 3; at > 0; at -= 3)
    digits.insert(static_cast<std::size_t>(at), ",");
  return digits;
}

template <class Visit>
void for_each_state(const Network& network, Visit&& visit) {
  for (const auto& item : network.named_parameters()) visit(item.key(), item.value());
  for (const auto& item : network.named_buffers()) visit(item.key(), item.value());
}

}  // namespace

std::vector<std::string> network_names() {
  std::vector<std::string> names;
  for (const auto& architecture : registry()) names.emplace_back(architecture.name);
  return names;
}

Json default_network_settings(const std::string& architecture) {
  return find_architecture(architecture).defaults;
}

Json full_settings(const NetworkDescription& description) {
  const Json settings = merged(find_architecture(description.architecture), description.settings);
  check_network_settings(description.architecture, settings);
  return settings;
}

std::shared_ptr<Network> make_network(const NetworkDescription& description) {
  const auto& architecture = find_architecture(description.architecture);
  const Json settings = full_settings(description);
  if (const double values = least_network_values(description.architecture, settings);
      values > kMostValues)
    throw InputError(fmt::format("settings of {}", architecture.name),
                     fmt::format("describe at least {} values, more than {}", count_text(values),
                                 count_text(kMostValues)),
                     "lower widths or depths");
  try {
    return architecture.make(settings);
  } catch (const Json::exception& error) {
    throw InputError(fmt::format("settings of {}", architecture.name),
                     fmt::format("they do not fit together ({})", error.what()),
                     fmt::format("start from the defaults: {}", architecture.defaults.dump()));
  } catch (const c10::Error& error) {
    throw InputError(fmt::format("settings of {}", architecture.name),
                     "no network can be built with them",
                     fmt::format("start from the defaults: {}", architecture.defaults.dump()));
  }
}

std::shared_ptr<Network> make_network(const NetworkDescription& description, const TensorFile& file,
                                      const std::string& source) {
  double stored = 0;
  for (const auto& [name, tensor] : file.tensors)
    stored +=
        static_cast<double>(tensor.bytes.size()) / static_cast<double>(dtype_size(tensor.dtype));
  const double needed = naming_source(source, [&] {
    return least_network_values(description.architecture, full_settings(description));
  });
  if (needed > stored)
    throw InputError(source,
                     fmt::format("holds {} values, but the {} that its settings describe has at "
                                 "least {}",
                                 count_text(stored), description.architecture, count_text(needed)),
                     "give weights of this architecture and size");
  auto network = make_network(description);
  load_weights(*network, file, "", source);
  return network;
}

std::int64_t parameter_count(const Network& network) {
  std::int64_t count = 0;
  for (const auto& parameter : network.parameters()) count += parameter.numel();
  return count;
}

torch::Tensor to_torch(const StoredTensor& stored) {
  const auto type = stored.dtype == "F32"    ? torch::kFloat
                    : stored.dtype == "F16"  ? torch::kHalf
                    : stored.dtype == "BF16" ? torch::kBFloat16
                                             : torch::kLong;
  auto tensor = torch::empty(stored.shape, type);
  MALUS_REQUIRE(tensor.nbytes() == stored.bytes.size());
  std::memcpy(tensor.data_ptr(), stored.bytes.data(), stored.bytes.size());
  return tensor;
}

StoredTensor from_torch(const torch::Tensor& tensor) {
  const auto type = tensor.scalar_type();
  const auto plain = tensor.detach().to(torch::kCPU).contiguous();
  StoredTensor stored;
  stored.dtype = type == torch::kFloat      ? "F32"
                 : type == torch::kHalf     ? "F16"
                 : type == torch::kBFloat16 ? "BF16"
                                            : "I64";
  stored.shape.assign(plain.sizes().begin(), plain.sizes().end());
  stored.bytes.resize(plain.nbytes());
  std::memcpy(stored.bytes.data(), plain.data_ptr(), plain.nbytes());
  return stored;
}

bool is_as_built(const torch::Tensor& buffer, const StoredTensor& stored) {
  const torch::Tensor values = to_torch(stored);
  return torch::equal(buffer.to(torch::kCPU, values.scalar_type()), values);
}

void load_weights(Network& network, const TensorFile& file, const std::string& prefix,
                  const std::string& source) {
  const torch::NoGradGuard no_gradients;
  std::size_t used = 0, present = 0;
  for (const auto& [name, unused] : file.tensors) present += name.starts_with(prefix) ? 1 : 0;
  const auto stored_for = [&](const std::string& name,
                              const torch::Tensor& state) -> const StoredTensor& {
    const auto found = file.tensors.find(prefix + name);
    if (found == file.tensors.end())
      throw InputError(source, fmt::format("it lacks the weight \"{}\"", prefix + name),
                       "give weights of this architecture and size");
    if (state.sizes() != torch::IntArrayRef(found->second.shape))
      throw InputError(
          source, fmt::format("weight \"{}\" has another shape than the network's", prefix + name),
          "give weights of this architecture and size");
    ++used;
    return found->second;
  };
  for (const auto& item : network.named_parameters())
    torch::Tensor(item.value()).copy_(to_torch(stored_for(item.key(), item.value())));
  for (const auto& item : network.named_buffers())
    if (!is_as_built(item.value(), stored_for(item.key(), item.value())))
      throw InputError(
          source,
          fmt::format("\"{}\" is not what the network's settings make it", prefix + item.key()),
          "give weights of this architecture and size");
  if (used != present)
    throw InputError(source,
                     fmt::format("has {} of no layer of the network",
                                 counted(std::int64_t(present - used), "weight")),
                     "give weights of this architecture and size");
}

TensorFile weights_of(const Network& network, const NetworkDescription& description) {
  TensorFile file;
  file.metadata["architecture"] = description.architecture;
  file.metadata["settings"] = description.settings.dump();
  for_each_state(network, [&](const std::string& name, const torch::Tensor& state) {
    file.tensors[name] = from_torch(state);
  });
  return file;
}

}  // namespace malus
