// libtorch's threads: it starts with one, whatever the machine has.
#pragma once

namespace malus {

/// Lets libtorch's operations use as many threads.
void use_network_threads(int threads);

}  // namespace malus
