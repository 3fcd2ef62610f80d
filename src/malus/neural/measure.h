// What a network costs: values, multiplications, seconds. Names no libtorch type.
#pragma once

#include "malus/neural/named_networks.h"

#include <cstdint>
#include <optional>

namespace malus {

struct NetworkCost {
  std::int64_t parameters = 0;
  double multiply_adds = 0;  ///< of a forward pass: convolutions, linear layers, attention products
  struct Time {
    double seconds = 0;  ///< median of a forward pass, batch 1
    double processor_seconds =
        0;  ///< the least of all threads together: tells more on a busy machine
  };
  Time float32;
  double peak_bytes = 0;  ///< that a float32 pass takes beside the weights; 0: not known
  /// Where the processor multiplies it, and how far its result lies from float32's: root mean
  /// square over the deviation of the result.
  std::optional<Time> bfloat16;
  double bfloat16_difference = 0;
};
/// channels x rows x cols of random values; weights are random too, none of them at a start of
/// zero. repetitions 0 measures neither time nor memory.
NetworkCost measure_network(const NamedNetwork& network, int channels, int rows, int cols,
                            int repetitions);

}  // namespace malus
