// Networks as libtorch modules that read like their papers. Parameter names are those of the public
// implementations, so that existing weights load. All take and give [batch, channel, row, column]
// float tensors of any size: padding is inside.
#pragma once

#include "malus/weights/safetensors.h"

#include <string>
#include <vector>

#include <nlohmann/json.hpp>
#include <torch/torch.h>

namespace malus {

/// What every network is: a module with one forward function.
class Network : public torch::nn::Module {
 public:
  virtual torch::Tensor forward(torch::Tensor x) = 0;
};

/// What a network is made of: the architecture's name and its settings, as stored in a weight
/// file's metadata.
struct NetworkDescription {
  std::string architecture;  ///< one of network_names()
  nlohmann::json settings;   ///< overrides of the architecture's defaults; unknown keys are refused
};

/// unet, nafnet, restormer, uformer, malus: a test loops over them.
std::vector<std::string> network_names();

/// Default settings of an architecture, every key present. Throws InputError on an unknown name.
nlohmann::json default_network_settings(const std::string& architecture);
/// Those with the description's in their place. Throws InputError as make_network does.
nlohmann::json full_settings(const NetworkDescription& description);

/// Builds with random weights (torch's own generator). Throws InputError on an unknown name or
/// setting, a wrong type, a value outside its range, or where the network would be too large.
std::shared_ptr<Network> make_network(const NetworkDescription& description);
/// Builds with a file's weights (load_weights); nothing is built that the file cannot fill. Throws
/// InputError.
std::shared_ptr<Network> make_network(const NetworkDescription& description, const TensorFile& file,
                                      const std::string& source);

/// Number of trainable values.
std::int64_t parameter_count(const Network& network);

/// Copies weights by name, with an optional prefix in the file. Every parameter and buffer must be
/// there with its shape, a buffer as the network built it (is_as_built), and nothing may be left
/// over; throws InputError with the first name that does not fit.
void load_weights(Network& network, const TensorFile& file, const std::string& prefix,
                  const std::string& source);

/// Whether a file holds a buffer as the network built it, of its settings alone.
bool is_as_built(const torch::Tensor& buffer, const StoredTensor& stored);

/// The state of a network as float32 tensors with metadata "architecture" and "settings".
TensorFile weights_of(const Network& network, const NetworkDescription& description);

/// Conversions that keep shape and type (float32, float16, bfloat16, int64).
torch::Tensor to_torch(const StoredTensor& tensor);
StoredTensor from_torch(const torch::Tensor& tensor);

}  // namespace malus
