// The denoiser of malus.denoise, where it is a network kept for the next call.
#pragma once

#include "malus/denoise/denoiser.h"
#include "malus/neural/inference.h"

#include <memory>
#include <mutex>
#include <string>
#include <vector>

#include "denoise_method.h"

namespace malus::python {

/// The keyword arguments of malus.denoise that the program has as flags.
struct DenoiseKeywords {
  DenoiseSettings filter;
  InferenceSettings network;

  template <class Self, class Visitor>
  static void describe(Self& self, Visitor&& field) {
    DenoiseSettings::describe(self.filter, field);
    InferenceSettings::describe(self.network, field);
  }
};

/// A denoiser that one thread uses at a time.
struct SharedDenoiser {
  SharedDenoiser(const DenoiseKeywords& keywords, bool variance)
      : denoiser(keywords.filter, keywords.network, variance) {}
  app::FrameDenoiser denoiser;
  std::mutex mutex;
};

/// A loop over frames gives the same file and settings again and again: the last network is kept
/// until others come, or its file is written anew. Call it with the interpreter's lock, which
/// guards what is kept; it is released while a file is read. Throws InputError.
std::shared_ptr<SharedDenoiser> denoiser_for(const DenoiseKeywords& keywords, bool variance);

/// For a process that was just forked: what its parent kept may be locked by a thread that this
/// process has not.
void forget_networks();

}  // namespace malus::python
