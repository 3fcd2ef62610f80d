#include "malus/neural/threads.h"

#include <ATen/Parallel.h>

namespace malus {

void use_network_threads(int threads) { at::set_num_threads(threads); }

}  // namespace malus
