#include "malus/neural/workers.h"

#include "malus/base/error.h"
#include "malus/base/worker_place.h"

#include <chrono>
#include <cstdlib>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <torch/version.h>
// libtorch's headers need those of Gloo and NCCL, which come in packages of their own.
#if defined(USE_C10D_GLOO) && __has_include(<gloo/algorithm.h>)
#define MALUS_WITH_GLOO
#include <torch/csrc/distributed/c10d/ProcessGroupGloo.hpp>
#endif
#if defined(USE_C10D_NCCL) && __has_include(<nccl.h>)
#define MALUS_WITH_NCCL
#include <torch/csrc/distributed/c10d/ProcessGroupNCCL.hpp>
#endif
#if defined(MALUS_WITH_GLOO) || defined(MALUS_WITH_NCCL)
#define MALUS_WITH_WORKERS
#include <torch/csrc/distributed/c10d/TCPStore.hpp>
#endif

namespace malus {
namespace {

class SingleWorker final : public Workers {
 public:
  int rank() const override { return 0; }
  int size() const override { return 1; }
  void sum(torch::Tensor&) override {}
  void broadcast(torch::Tensor&) override {}
  void wait_for_leader() override {}
};

#if defined(MALUS_WITH_WORKERS)
#if TORCH_VERSION_MAJOR >= 2
using Backend = c10d::Backend;
#else
using Backend = c10d::ProcessGroup;
#endif

class WorkerGroup final : public Workers {
 public:
  WorkerGroup(WorkerPlace place, c10::intrusive_ptr<c10d::Store> store,
              c10::intrusive_ptr<Backend> group)
      : place_(place), store_(std::move(store)), group_(std::move(group)) {}
  int rank() const override { return place_.rank; }
  int size() const override { return place_.size; }
  void sum(torch::Tensor& values) override {
    run([&, list = std::vector{values}]() mutable { group_->allreduce(list)->wait(); });
  }
  void broadcast(torch::Tensor& values) override {
    run([&, list = std::vector{values}]() mutable { group_->broadcast(list)->wait(); });
  }
  // Messages of the group know its one time limit only; the store waits as long as it is told.
  void wait_for_leader() override {
    const std::string key = fmt::format("malus/leader_done/{}", waits_++);
    run([&] {
      if (place_.rank == 0)
        store_->set(key, std::vector<std::uint8_t>{1});
      else
        store_->wait({key}, kNoLimit);
    });
  }

 private:
  static constexpr std::chrono::milliseconds kNoLimit = std::chrono::hours(24 * 365);

  template <class Call>
  void run(Call call) {
    try {
      call();
    } catch (const std::exception& error) {
      const std::string text = error.what();
      throw InputError(fmt::format("worker {} of {}", place_.rank, place_.size),
                       "another worker was lost (" + text.substr(0, text.find('\n')) + ")",
                       "start all workers again with --resume: the last checkpoint is good");
    }
  }

  WorkerPlace place_;
  c10::intrusive_ptr<c10d::Store> store_;
  c10::intrusive_ptr<Backend> group_;
  std::int64_t waits_ = 0;
};

c10::intrusive_ptr<Backend> make_group(const WorkerPlace& place,
                                       const c10::intrusive_ptr<c10d::Store>& store,
                                       std::chrono::milliseconds timeout,
                                       [[maybe_unused]] const torch::Device& device) {
#if defined(MALUS_WITH_NCCL)
  if (device.is_cuda()) {
    auto options = c10d::ProcessGroupNCCL::Options::create();
    options->timeout = timeout;
    return c10::make_intrusive<c10d::ProcessGroupNCCL>(store, place.rank, place.size, options);
  }
#endif
#if defined(MALUS_WITH_GLOO)
  auto options = c10d::ProcessGroupGloo::Options::create(timeout);
  // The same variable as PyTorch's own programs: the network interface to listen on.
  const char* interface = std::getenv("GLOO_SOCKET_IFNAME");
  options->devices.push_back(interface ? c10d::ProcessGroupGloo::createDeviceForInterface(interface)
                                       : c10d::ProcessGroupGloo::createDefaultDevice());
  return c10::make_intrusive<c10d::ProcessGroupGloo>(store, place.rank, place.size, options);
#else
  static_cast<void>(timeout);
  throw std::runtime_error("this program has no group for " + device.str());
#endif
}

std::unique_ptr<Workers> meet_others(const WorkerPlace& place, double timeout_s,
                                     const torch::Device& device) {
  const char* address = std::getenv("MASTER_ADDR");
  const std::chrono::milliseconds timeout(static_cast<std::int64_t>(timeout_s * 1000));
  c10d::TCPStoreOptions options;
  options.port = static_cast<std::uint16_t>(
      number_of_environment({"MASTER_PORT"}, c10d::TCPStoreOptions::kDefaultPort));
  // torchrun serves the meeting point itself.
  const char* served = std::getenv("TORCHELASTIC_USE_AGENT_STORE");
  options.isServer = place.rank == 0 && !(served && std::string(served) == "True");
  options.numWorkers = static_cast<std::size_t>(place.size);
  options.timeout = timeout;
  const std::string host = address ? address : "127.0.0.1";
  try {
    const auto store = c10::make_intrusive<c10d::TCPStore>(host, options);
    return std::make_unique<WorkerGroup>(place, store, make_group(place, store, timeout, device));
  } catch (const std::exception& error) {
    const std::string text = error.what();
    throw InputError(fmt::format("worker {} of {}", place.rank, place.size),
                     fmt::format("does not meet the others at {}:{} ({})", host, options.port,
                                 text.substr(0, text.find('\n'))),
                     "check MASTER_ADDR and MASTER_PORT, and that all workers were started");
  }
}
#endif

}  // namespace

std::unique_ptr<Workers> single_worker() { return std::make_unique<SingleWorker>(); }

std::unique_ptr<Workers> workers_of_environment(double timeout_s, const torch::Device& device) {
  const WorkerPlace place = worker_place_of_environment();
  require_place(place, "set RANK and WORLD_SIZE, or start with torchrun, mpirun or srun");
  if (place.size == 1) return single_worker();
  return meet_workers(place, timeout_s, device);
}

std::unique_ptr<Workers> meet_workers(const WorkerPlace& place, double timeout_s,
                                      const torch::Device& device) {
#if defined(MALUS_WITH_WORKERS)
  return meet_others(place, timeout_s, device);
#else
  static_cast<void>(timeout_s);
  static_cast<void>(device);
  throw InputError(fmt::format("worker {} of {}", place.rank, place.size),
                   "this program was built for one worker",
                   "install libgloo-dev (for GPUs NCCL's header) and build again");
#endif
}

}  // namespace malus
