// Writes frames on threads of its own behind a bounded queue, so that the camera's stream is never
// kept waiting by a disk that is fast enough on average.
#pragma once

#include "malus/image/raw_frame.h"

#include <condition_variable>
#include <deque>
#include <exception>
#include <filesystem>
#include <mutex>
#include <thread>
#include <vector>

namespace malus {

class FrameWriter {
 public:
  FrameWriter(int threads, std::size_t most_waiting);
  ~FrameWriter();
  FrameWriter(const FrameWriter&) = delete;
  FrameWriter& operator=(const FrameWriter&) = delete;

  /// Waits while the queue is full. Rethrows the first error of a writing thread.
  void write(std::filesystem::path path, RawFrame frame);
  /// Waits until everything is written. Rethrows the first error.
  void finish();

 private:
  explicit FrameWriter(std::size_t most_waiting);
  struct Job {
    std::filesystem::path path;
    RawFrame frame;
  };
  void work();
  void rethrow_error();

  std::mutex mutex_;
  std::condition_variable room_, jobs_, idle_;
  std::deque<Job> queue_;
  std::size_t most_waiting_;
  int busy_ = 0;
  bool closing_ = false;
  std::exception_ptr error_;
  std::vector<std::thread> threads_;
};

}  // namespace malus
