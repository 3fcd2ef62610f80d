#include "malus/neural/torch_checkpoint.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/base/settings_check.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/neural/internal/json_text.h"
#include "malus/neural/named_networks.h"
#include "malus/neural/package.h"
#include "malus/weights/torch_archive.h"

#include <algorithm>
#include <cstring>

#include <fmt/format.h>

namespace malus {
namespace {

using Json = nlohmann::json;

torch::ScalarType type_of(const std::string& dtype) {
  return dtype == "F32"    ? torch::kFloat
         : dtype == "F16"  ? torch::kHalf
         : dtype == "BF16" ? torch::kBFloat16
         : dtype == "F64"  ? torch::kDouble
         : dtype == "I64"  ? torch::kLong
         : dtype == "I32"  ? torch::kInt
                           : torch::kByte;
}

torch::Tensor tensor_of(const ArchivedTensor& archived) {
  const auto type = type_of(archived.dtype);
  if (archived.values.empty()) return torch::empty(archived.shape, type);
  // An archive's values may lie at any byte.
  const auto size = static_cast<std::int64_t>(torch::elementSize(type));
  const auto values = torch::empty({std::ssize(archived.values) / size}, type);
  std::memcpy(values.data_ptr(), archived.values.data(), archived.values.size());
  return values.as_strided(archived.shape, archived.stride);
}

// What a public network usually is: linear light in and out, nothing else.
PackageSettings package_settings(const Json& wanted) {
  PackageSettings settings;
  settings.domain = "linear";
  settings.noise_input = settings.guide = "none";
  settings.residual = settings.row_noise = false;
  std::vector<std::string> known;
  std::size_t used = 0;
  PackageSettings::describe(settings, [&](auto& value, const ParameterInfo& info) {
    known.push_back(info.name);
    if (!wanted.contains(info.name)) return;
    const Json& given = wanted.at(info.name);
    if (given.is_boolean() != std::is_same_v<std::decay_t<decltype(value)>, bool> ||
        !(given.is_boolean() || given.is_string()))
      throw InputError(setting_name("package"),
                       fmt::format("\"{}\" is {}", info.name, given.dump()), info.help);
    value = given.get<std::decay_t<decltype(value)>>();
    if (const std::string remedy = setting_remedy(value, info); !remedy.empty())
      throw InputError(setting_name("package"),
                       fmt::format("\"{}\" is {}", info.name, given.dump()), remedy);
    ++used;
  });
  if (used != wanted.size())
    for (const auto& [name, value] : wanted.items())
      if (std::find(known.begin(), known.end(), name) == known.end())
        throw InputError(setting_name("package"), fmt::format("\"{}\" is not known", name),
                         did_you_mean(name, known, true) + "known: " + joined(known));
  return settings;
}

}  // namespace

TensorFile read_torch_checkpoint(const std::filesystem::path& path) {
  const std::vector<std::byte> bytes = read_weight_file(path);
  TensorFile file;
  if (path.extension() == ".safetensors") {
    for (const auto& [name, stored] : parse_tensor_file(bytes, path.string()).tensors)
      file.tensors[name] =
          stored.dtype == "I64" ? stored : from_torch(to_torch(stored).to(torch::kFloat));
    return file;
  }
  for (const ArchivedTensor& archived : parse_torch_archive(bytes, path.string())) {
    const auto tensor = tensor_of(archived);
    file.tensors[archived.name] =
        from_torch(tensor.to(tensor.is_floating_point() ? torch::kFloat : torch::kLong));
  }
  return file;
}

nlohmann::ordered_json import_checkpoint(const ImportRequest& request) {
  const std::string source = request.checkpoint.string();
  check_output(request.output, request.force);
  NetworkPackage package;
  package.settings = package_settings(request.package);
  NamedNetwork named = network_of_name(request.architecture);
  named.settings.update(request.settings.is_null() ? Json::object() : request.settings);
  package.network = fitted_network({named.architecture, named.settings}, package.settings);
  package.training = {{"imported_from", json_text(request.checkpoint.filename().string())}};
  full_settings(package.network);  // mistakes in them come before those in the file
  const auto network =
      make_network(package.network, read_torch_checkpoint(request.checkpoint), source);
  const TensorFile file = package_file(package, *network);
  check_finite(file, source);
  package_of(file, source);  // what would be refused when read is refused before it is written
  save_tensor_file(file, request.output);
  return {{"architecture", package.network.architecture},
          {"settings", package.network.settings},
          {"parameters", parameter_count(*network)},
          {"file", request.output.string()}};
}

}  // namespace malus
