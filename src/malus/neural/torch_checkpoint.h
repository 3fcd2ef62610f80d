// Weights from the files that PyTorch's torch.save writes (.pth, .pt), read without running
// anything in them, and from safetensors files without a package of ours.
#pragma once

#include "malus/weights/safetensors.h"

#include <filesystem>
#include <string>

#include <nlohmann/json.hpp>

namespace malus {

/// The tensors of a saved state dict, as float32 and I64, by name; where they are looked for:
/// malus/weights/torch_archive.h; of a .safetensors file all. Throws InputError, also on files
/// older than PyTorch 1.6 (no zip).
TensorFile read_torch_checkpoint(const std::filesystem::path& path);

struct ImportRequest {
  std::filesystem::path checkpoint, output;
  std::string architecture;
  nlohmann::json settings;  ///< the architecture's, where they differ from the defaults
  nlohmann::json package;   ///< PackageSettings, where they differ from: linear, no noise input, no
                            ///< guide, no residual, no row noise removal
  bool force = false;
};

/// Reads a checkpoint, checks that it fits the architecture and writes a weight file that `denoise`
/// takes. Result: architecture, settings, parameters, file. Throws InputError.
nlohmann::ordered_json import_checkpoint(const ImportRequest& request);

}  // namespace malus
