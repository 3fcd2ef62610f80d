#include "malus/capture/internal/frame_writer.h"

#include "malus/io/picture_file.h"

namespace malus {

FrameWriter::FrameWriter(std::size_t most_waiting) : most_waiting_(most_waiting) {}

// Delegates, so that the destructor ends the threads that run where the system refuses one more.
FrameWriter::FrameWriter(int threads, std::size_t most_waiting) : FrameWriter(most_waiting) {
  for (int i = 0; i < threads; ++i) threads_.emplace_back([this] { work(); });
}

FrameWriter::~FrameWriter() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  jobs_.notify_all();
  for (auto& thread : threads_) thread.join();
}

void FrameWriter::rethrow_error() {
  if (error_) std::rethrow_exception(error_);
}

void FrameWriter::write(std::filesystem::path path, RawFrame frame) {
  std::unique_lock lock(mutex_);
  room_.wait(lock, [&] { return queue_.size() < most_waiting_ || error_; });
  rethrow_error();
  queue_.push_back({std::move(path), std::move(frame)});
  lock.unlock();
  jobs_.notify_one();
}

void FrameWriter::finish() {
  std::unique_lock lock(mutex_);
  idle_.wait(lock, [&] { return (queue_.empty() && busy_ == 0) || error_; });
  rethrow_error();
}

void FrameWriter::work() {
  for (;;) {
    std::unique_lock lock(mutex_);
    jobs_.wait(lock, [&] { return !queue_.empty() || closing_; });
    if (queue_.empty()) return;
    Job job = std::move(queue_.front());
    queue_.pop_front();
    ++busy_;
    lock.unlock();
    room_.notify_one();
    try {
      SaveOptions options;
      options.type = SampleType::kUint16;
      options.force = true;  // the same frame of an interrupted run
      save_frame(job.path, job.frame, options);
    } catch (...) {
      const std::lock_guard relock(mutex_);
      if (!error_) error_ = std::current_exception();
    }
    lock.lock();
    --busy_;
    if (error_ || (queue_.empty() && busy_ == 0)) {
      idle_.notify_all();
      room_.notify_all();
    }
  }
}

}  // namespace malus
