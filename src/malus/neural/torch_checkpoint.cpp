#include "malus/neural/torch_checkpoint.h"

#include "malus/base/atomic_file.h"
#include "malus/base/error.h"
#include "malus/neural/package.h"
#include "malus/neural/pickle.h"

#include <algorithm>

#include <caffe2/serialize/inline_container.h>
#include <fmt/format.h>

namespace malus {
namespace {

using caffe2::serialize::PyTorchStreamReader;
using Kind = PickleValue::Kind;
using Json = nlohmann::json;

constexpr const char* kRemedy = "save the state dict again with torch.save";

torch::ScalarType type_of(const std::string& dtype) {
  return dtype == "F32"    ? torch::kFloat
         : dtype == "F16"  ? torch::kHalf
         : dtype == "BF16" ? torch::kBFloat16
         : dtype == "F64"  ? torch::kDouble
         : dtype == "I64"  ? torch::kLong
         : dtype == "I32"  ? torch::kInt
                           : torch::kByte;
}

// A bounded view of its storage, as a contiguous tensor.
torch::Tensor tensor_of(const PickleTensor& stored, PyTorchStreamReader& archive,
                        const std::string& name, const std::string& source) {
  const auto fail = [&](const char* problem) -> void {
    throw InputError(source, fmt::format("weight \"{}\" {}", name, problem), kRemedy);
  };
  if (stored.storage.dtype.empty()) fail("has a type that weights do not have");
  if (stored.shape.size() != stored.stride.size() || stored.shape.size() > 8)
    fail("has no proper shape");
  auto [data, bytes] = archive.getRecord("data/" + stored.storage.key);
  const auto type = type_of(stored.storage.dtype);
  const auto available = static_cast<std::int64_t>(bytes / torch::elementSize(type));
  std::int64_t last = stored.offset;
  bool empty = false;
  for (std::size_t i = 0; i < stored.shape.size(); ++i) {
    const auto size = stored.shape[i], stride = stored.stride[i];
    if (size < 0 || stride < 0 || size > available || stride > available)
      fail("reaches beyond its data");
    empty = empty || size == 0;
    last += std::max<std::int64_t>(size - 1, 0) * stride;
  }
  if (stored.offset < 0 || (!empty && last >= available)) fail("reaches beyond its data");
  const auto values = torch::from_blob(data.get(), {available}, type);
  return values.as_strided(stored.shape, stored.stride, stored.offset).clone();
}

// Every tensor of a table by its key; empty where it holds none.
std::vector<std::pair<std::string, const PickleTensor*>> tensors_in(const PickleValue& value) {
  std::vector<std::pair<std::string, const PickleTensor*>> tensors;
  for (const auto& [key, item] : value.table)
    if (key->kind == Kind::kText && item->kind == Kind::kTensor)
      tensors.emplace_back(key->text, &item->tensor);
  return tensors;
}

std::vector<std::pair<std::string, const PickleTensor*>> weights_in(const PickleValue& value,
                                                                    const std::string& source) {
  auto tensors = tensors_in(value);
  for (const char* name :
       {"params_ema", "params", "state_dict", "model_state_dict", "model", "weights"})
    for (const auto& [key, item] : value.table)
      if (tensors.empty() && key->text == name) tensors = tensors_in(*item);
  if (tensors.empty()) throw InputError(source, "holds no table of weights", kRemedy);
  constexpr std::string_view kParallel = "module.";
  if (std::all_of(tensors.begin(), tensors.end(),
                  [&](const auto& t) { return t.first.starts_with(kParallel); }))
    for (auto& tensor : tensors) tensor.first.erase(0, kParallel.size());
  return tensors;
}

// What a public network usually is: linear light in and out, nothing else.
PackageSettings package_settings(const Json& wanted) {
  PackageSettings settings;
  settings.domain = "linear";
  settings.noise_input = settings.guide = "none";
  settings.residual = settings.row_noise = false;
  std::string known;
  std::size_t used = 0;
  PackageSettings::describe(settings, [&](auto& value, const ParameterInfo& info) {
    known += (known.empty() ? "" : ", ") + info.name;
    if (!wanted.contains(info.name)) return;
    const Json& given = wanted.at(info.name);
    if (given.is_boolean() != std::is_same_v<std::decay_t<decltype(value)>, bool> ||
        !(given.is_boolean() || given.is_string()))
      throw InputError("--package", fmt::format("\"{}\" is {}", info.name, given.dump()),
                       info.help);
    value = given.get<std::decay_t<decltype(value)>>();
    ++used;
  });
  if (used != wanted.size())
    throw InputError("--package", wanted.dump() + " names a setting that is not known",
                     "the settings are " + known);
  return settings;
}

}  // namespace

TensorFile read_torch_checkpoint(const std::filesystem::path& path) {
  const std::string source = path.string();
  if (!std::filesystem::is_regular_file(path))
    throw InputError(source, "is no file", "give a checkpoint written by torch.save");
  try {
    PyTorchStreamReader archive(source);
    auto [data, bytes] = archive.getRecord("data.pkl");
    const auto root =
        parse_pickle({static_cast<const std::byte*>(data.get()), bytes}, source + " (data.pkl)");
    TensorFile file;
    for (const auto& [name, stored] : weights_in(*root, source)) {
      const auto tensor = tensor_of(*stored, archive, name, source);
      file.tensors[name] = from_torch(tensor.is_floating_point() ? tensor.to(torch::kFloat)
                                                                 : tensor.to(torch::kLong));
    }
    return file;
  } catch (const c10::Error&) {
    throw InputError(source, "is no whole archive of torch.save (PyTorch 1.6 or newer)", kRemedy);
  }
}

nlohmann::ordered_json import_checkpoint(const ImportRequest& request) {
  const std::string source = request.checkpoint.string();
  check_output(request.output, request.force);
  NetworkPackage package;
  package.settings = package_settings(request.package);
  package.network = fitted_network({request.architecture, request.settings}, package.settings);
  package.training = {{"imported_from", request.checkpoint.filename().string()}};
  const auto network = make_network(package.network);
  load_weights(*network, read_torch_checkpoint(request.checkpoint), "", source);
  const TensorFile file = package_file(package, *network);
  package_of(file, source);  // what would be refused when read is refused before it is written
  save_tensor_file(file, request.output);
  return {{"architecture", package.network.architecture},
          {"settings", package.network.settings},
          {"parameters", parameter_count(*network)},
          {"file", request.output.string()}};
}

}  // namespace malus
