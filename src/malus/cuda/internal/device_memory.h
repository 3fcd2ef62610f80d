// Memory of the device, and of the host for copies that the host does not wait for.
#pragma once

#include "malus/cuda/device.h"

#include <algorithm>
#include <cstddef>
#include <utility>
#include <vector>

#include <cuda_runtime.h>

namespace malus::cuda {

/// Numbers in the device's memory. Allocating, filling and freeing wait for the device.
template <class T>
class DeviceArray {
 public:
  DeviceArray() = default;
  explicit DeviceArray(std::size_t count) {
    if (count > 0) check_status(cudaMalloc(&data_, count * sizeof(T)), "allocating memory");
  }
  explicit DeviceArray(const std::vector<T>& values) : DeviceArray(values.size()) {
    if (!values.empty())
      check_status(
          cudaMemcpy(data_, values.data(), values.size() * sizeof(T), cudaMemcpyHostToDevice),
          "copying to the device");
  }
  ~DeviceArray() { cudaFree(data_); }
  DeviceArray(DeviceArray&& other) noexcept : data_(std::exchange(other.data_, nullptr)) {}
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(data_, other.data_);
    return *this;
  }
  T* get() const { return data_; }

 private:
  T* data_ = nullptr;
};

/// Host memory that the device reads by itself, and the event that says when it has.
class SendBuffer {
 public:
  SendBuffer() {
    check_status(cudaEventCreateWithFlags(&sent_, cudaEventDisableTiming), "making an event");
  }
  ~SendBuffer() {
    cudaEventSynchronize(sent_);
    cudaFreeHost(data_);
    cudaEventDestroy(sent_);
  }
  SendBuffer(const SendBuffer&) = delete;
  SendBuffer& operator=(const SendBuffer&) = delete;

  /// Copies in the order of the default stream, and does not wait for it; waits for the copy that
  /// this buffer sent before.
  void send(const std::vector<float>& values, float* to) {
    check_status(cudaEventSynchronize(sent_), "waiting for a copy");
    if (values.size() > held_) {
      cudaFreeHost(std::exchange(data_, nullptr));
      held_ = 0;
      check_status(cudaMallocHost(&data_, values.size() * sizeof(float)), "allocating memory");
      held_ = values.size();
    }
    std::copy(values.begin(), values.end(), data_);
    check_status(cudaMemcpyAsync(to, data_, values.size() * sizeof(float), cudaMemcpyHostToDevice),
                 "copying to the device");
    check_status(cudaEventRecord(sent_), "copying to the device");
  }

 private:
  cudaEvent_t sent_{};
  float* data_ = nullptr;
  std::size_t held_ = 0;
};

}  // namespace malus::cuda
