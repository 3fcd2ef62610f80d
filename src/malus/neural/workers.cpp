#include "malus/neural/workers.h"

#include "malus/base/error.h"
#include "malus/base/stopwatch.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/base/worker_place.h"
#include "malus/neural/internal/short_waits.h"

#include <chrono>
#include <cstdlib>
#include <exception>
#include <string>
#include <string_view>
#include <thread>
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
#include <torch/csrc/distributed/c10d/PrefixStore.hpp>
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

using std::chrono::milliseconds;

constexpr milliseconds kBetweenLooks(100);
constexpr std::chrono::microseconds kBetweenLooksAtAGpu(100);
constexpr double kPatienceS = 5;  // of one that is to stop, for the others

class WorkerGroup final : public Workers {
 public:
  WorkerGroup(WorkerPlace place, c10::intrusive_ptr<c10d::Store> store,
              c10::intrusive_ptr<Backend> group, Progress& progress)
      : place_(place), store_(std::move(store)), group_(std::move(group)), progress_(progress) {}
  int rank() const override { return place_.rank; }
  int size() const override { return place_.size; }
  void sum(torch::Tensor& values) override {
    run([&, list = std::vector{values}]() mutable { finish(*group_->allreduce(list), values); });
  }
  void broadcast(torch::Tensor& values) override {
    run([&, list = std::vector{values}]() mutable { finish(*group_->broadcast(list), values); });
  }
  // Messages of the group know its one time limit only; the store is asked as long as we like.
  void wait_for_leader() override {
    const std::string key = fmt::format("malus/leader_done/{}", waits_++);
    run([&] {
      if (place_.rank == 0) return store_->set(key, std::vector<std::uint8_t>{1});
      Stopwatch since_asked;
      while (!store_->check({key})) {
        leave_when_asked(since_asked);
        std::this_thread::sleep_for(kBetweenLooks);
      }
    });
  }

 private:
  template <class Call>
  void run(Call call) {
    try {
      call();
    } catch (const Cancelled&) {
      throw;
    } catch (const std::exception& error) {
      if (progress_.stop_requested())
        throw Cancelled();  // the others heard it too, and were faster
      const std::string text = error.what();
      throw InputError(fmt::format("worker {} of {}", place_.rank, place_.size),
                       "another worker was lost (" + text.substr(0, text.find('\n')) + ")",
                       "start all workers again with " + setting("resume", true) +
                           ": the last checkpoint is good");
    }
  }

  // Looks at the wish to stop between short waits.
  template <class Work>
  void finish(Work& work, const torch::Tensor& values) {
    Stopwatch since_asked;
    if (values.is_cuda()) {
      while (!work.isCompleted()) {
        leave_when_asked(since_asked);
        std::this_thread::sleep_for(kBetweenLooksAtAGpu);
      }
      if (work.exception()) {
        abandon();
        std::rethrow_exception(work.exception());
      }
      work.wait();  // blocks nothing but the GPU's queue
      return;
    }
    finish_in_short_waits(work, kBetweenLooks, [&] { leave_when_asked(since_asked); });
  }

  void leave_when_asked(Stopwatch& since_asked) {
    if (!progress_.stop_requested()) since_asked = Stopwatch();
    if (since_asked.seconds() < kPatienceS) return;
    abandon();
    throw Cancelled();
  }

  // Its end would wait for the message that is under way; on a GPU so would everything else.
  void abandon() {
#if TORCH_VERSION_MAJOR >= 2
    group_->abort();
#endif
    static_cast<void>(group_.release());
  }

  WorkerPlace place_;
  c10::intrusive_ptr<c10d::Store> store_;
  c10::intrusive_ptr<Backend> group_;
  Progress& progress_;
  std::int64_t waits_ = 0;
};

c10::intrusive_ptr<Backend> make_group(const WorkerPlace& place,
                                       const c10::intrusive_ptr<c10d::Store>& store,
                                       std::chrono::milliseconds timeout,
                                       [[maybe_unused]] const torch::Device& device) {
#if defined(MALUS_WITH_NCCL)
  if (device.is_cuda()) {
    // Else PyTorch's watchdog ends the process, without our words, where another worker is lost.
    for (const char* name : {"TORCH_NCCL_ASYNC_ERROR_HANDLING", "NCCL_ASYNC_ERROR_HANDLING"})
      setenv(name, "0", 0);
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

// torchrun serves the meeting point itself.
bool is_served_by_torchrun() {
  const char* served = std::getenv("TORCHELASTIC_USE_AGENT_STORE");
  return served && std::string_view(served) == "True";
}

// What the workers of this attempt leave there: torchrun's outlives them, and those that it starts
// again (--max_restarts) would find the addresses of the lost ones. Named as by PyTorch's programs.
c10::intrusive_ptr<c10d::Store> of_this_attempt(c10::intrusive_ptr<c10d::Store> store) {
  const char* attempt = std::getenv("TORCHELASTIC_RESTART_COUNT");
  if (!is_served_by_torchrun() || !attempt) return store;
  return c10::make_intrusive<c10d::PrefixStore>(fmt::format("/worker/attempt_{}", attempt), store);
}

// Where the workers meet, and until when.
struct Meeting {
  WorkerPlace place;
  std::string host;
  c10d::TCPStoreOptions options;
  double timeout_s;
  Progress& progress;
  Stopwatch waited = {};
  bool told = false;

  Meeting(const WorkerPlace& worker, double limit_s, Progress& its_progress)
      : place(worker), timeout_s(limit_s), progress(its_progress) {
    const char* address = std::getenv("MASTER_ADDR");
    host = address ? address : "127.0.0.1";
    options.port = static_cast<std::uint16_t>(
        number_of_environment({"MASTER_PORT"}, c10d::TCPStoreOptions::kDefaultPort));
    options.isServer = place.rank == 0 && !is_served_by_torchrun();
    options.numWorkers = static_cast<std::size_t>(place.size);
    options.waitWorkers = false;  // wait_for_all can be stopped
  }

  bool over() const { return waited.seconds() > timeout_s; }
  void look_around(const std::string& awaited) {
    constexpr double kSilentS = 1;
    check_stop(progress);
    if (told || waited.seconds() < kSilentS) return;
    progress.note(fmt::format("waiting for {} at {}:{}", awaited, host, options.port));
    told = true;
  }
};

// Short attempts, for a wish to stop is looked at between them alone.
c10::intrusive_ptr<c10d::Store> connect(Meeting& meeting) {
  meeting.options.timeout = std::chrono::seconds(1);
  for (;;) {
    try {
      const auto store = c10::make_intrusive<c10d::TCPStore>(meeting.host, meeting.options);
      store->setTimeout(milliseconds(static_cast<std::int64_t>(meeting.timeout_s * 1000)));
      return of_this_attempt(store);
    } catch (const std::exception& error) {
      // Names and ports that cannot be are said at once.
      const bool nobody_yet = std::string_view(error.what()).find("timed out") != std::string::npos;
      if (meeting.over() || !nobody_yet) throw;
    }
    meeting.look_around("worker 0");
    std::this_thread::sleep_for(kBetweenLooks);
  }
}

void wait_for_all(Meeting& meeting, c10d::Store& store) {
  constexpr const char* kArrived = "malus/arrived";
  std::int64_t there = store.add(kArrived, 1);
  for (; there < meeting.place.size; there = store.add(kArrived, 0)) {
    const std::int64_t missing = meeting.place.size - there;
    if (meeting.over())
      throw std::runtime_error(fmt::format("{} missing after {:g} s", missing, meeting.timeout_s));
    meeting.look_around(counted(missing, "worker"));
    std::this_thread::sleep_for(kBetweenLooks);
  }
}

std::unique_ptr<Workers> meet_others(const WorkerPlace& place, double timeout_s,
                                     const torch::Device& device, Progress& progress) {
  Meeting meeting(place, timeout_s, progress);
  try {
    const auto store = connect(meeting);
    wait_for_all(meeting, *store);
    const milliseconds timeout(static_cast<std::int64_t>(timeout_s * 1000));
    return std::make_unique<WorkerGroup>(place, store, make_group(place, store, timeout, device),
                                         progress);
  } catch (const Cancelled&) {
    throw;
  } catch (const std::exception& error) {
    const std::string text = error.what();
    throw InputError(fmt::format("worker {} of {}", place.rank, place.size),
                     fmt::format("does not meet the others at {}:{} ({})", meeting.host,
                                 meeting.options.port, text.substr(0, text.find('\n'))),
                     "check MASTER_ADDR and MASTER_PORT, and that all workers were started");
  }
}
#endif

}  // namespace

std::unique_ptr<Workers> single_worker() { return std::make_unique<SingleWorker>(); }

std::unique_ptr<Workers> workers_of_environment(double timeout_s, const torch::Device& device,
                                                Progress& progress) {
  const WorkerPlace place = worker_place_of_environment();
  require_place(place, "set RANK and WORLD_SIZE, or start with torchrun, mpirun or srun");
  if (place.size == 1) return single_worker();
  return meet_workers(place, timeout_s, device, progress);
}

std::unique_ptr<Workers> meet_workers(const WorkerPlace& place, double timeout_s,
                                      const torch::Device& device, Progress& progress) {
#if defined(MALUS_WITH_WORKERS)
  return meet_others(place, timeout_s, device, progress);
#else
  static_cast<void>(timeout_s);
  static_cast<void>(device);
  static_cast<void>(progress);
  throw InputError(fmt::format("worker {} of {}", place.rank, place.size),
                   "this program was built for one worker",
                   "install libgloo-dev (for GPUs NCCL's header) and build again");
#endif
}

}  // namespace malus
