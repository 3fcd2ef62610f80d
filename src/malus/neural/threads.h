// libtorch's threads: it starts with one, whatever the machine has.
#pragma once

namespace malus {

/// Lets libtorch's operations use as many threads.
void use_network_threads(int threads);

/// While it lives, libtorch's operations of this thread use this many threads, or as many as malus
/// (thread_count) does then; afterwards as many as before, for a process that uses libtorch for
/// itself. Of a libtorch without OpenMP the number is left as it is.
class NetworkThreads {
 public:
  NetworkThreads();
  explicit NetworkThreads(int threads);
  ~NetworkThreads();
  NetworkThreads(const NetworkThreads&) = delete;
  NetworkThreads& operator=(const NetworkThreads&) = delete;

 private:
  int before_;
};

}  // namespace malus
