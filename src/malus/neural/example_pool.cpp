#include "malus/neural/internal/example_pool.h"

#include "malus/base/error.h"
#include "malus/base/parallel.h"
#include "malus/base/pick.h"
#include "malus/base/stopwatch.h"
#include "malus/polar/demosaick.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>

namespace malus {
namespace {

// Where the refresh is measured: the first batches, which do not count (a GPU chooses its kernels),
// and the share of the makers' pace that is asked of them.
constexpr int kSettlingSteps = ExamplePool::kMeasuringSteps / 5;
constexpr double kShareOfPace = 0.9;

// Pixels that are not known are filled for the sake of their neighbours, and forgotten after it.
Planes colors_of(const Image& clean_dn, const SensorLayout& layout) {
  Planes colors = demosaick_bayer(clean_dn, layout);
  for (Image& plane : colors)
    for (std::size_t i = 0; i < plane.size(); ++i)
      if (std::isnan(clean_dn.values()[i])) plane.values()[i] = clean_dn.values()[i];
  return colors;
}

}  // namespace

PoolShape pool_shape(const TrainingConfig& config, const Workers& workers, bool on_gpu,
                     const Refresh& refresh) {
  if (config.train.batch % workers.size() != 0)
    throw InputError(config.source.string(),
                     fmt::format("batch = {} cannot be shared by {} workers evenly",
                                 config.train.batch, workers.size()),
                     "use a multiple of their number");
  const SensorLayout layout = config.package.layout();
  PoolShape shape;
  shape.batch = config.train.batch;
  shape.places = config.train.batch / workers.size();
  shape.first_place = workers.rank() * shape.places;
  shape.pool = config.data.pool;
  shape.refresh = refresh;
  shape.patch_rows = config.data.patch / layout.rows();
  shape.patch_cols = config.data.patch / layout.cols();
  // The steps of a CPU need the cores themselves.
  if (on_gpu) shape.makers = std::max(1, thread_count() - 2);
  return shape;
}

TrainingExample make_example(const RawPair& pair, const NetworkPackage& package) {
  const torch::NoGradGuard no_gradients;
  const PackageSettings& settings = package.settings;
  // Nobody hears how the noise fits the profile; to find out would take a fifth of the time.
  const NetworkFrame frame =
      prepare_network_frame(pair.noisy, pair.profile, settings, {}, pair.ratio, silent_progress(),
                            {.noise_check = false});
  const MosaicWindow whole{0, 0, pair.clean_dn.rows(), pair.clean_dn.cols()};
  const torch::Tensor input = prepare_input(frame, whole)[0].clone();
  if (!package.gives_picture())
    return {input, frame.domain.clean_planes(pair.clean_dn)[0], pair.noisy.source};
  const Planes rgb_dn = pair.clean_rgb_dn.channels() == 3
                            ? pair.clean_rgb_dn
                            : colors_of(pair.clean_dn, package.layout());
  return {input, picture_target(settings, frame.domain, rgb_dn)[0], pair.noisy.source};
}

// Delegates, so that the destructor ends the threads that run where the system refuses one more.
ExamplePool::ExamplePool(Maker maker, const PoolShape& shape, std::uint64_t seed,
                         std::int64_t first_step)
    : ExamplePool(std::move(maker), shape, seed) {
  wanted_ = newest_wanted(first_step);
  first_generation_ =
      std::max<std::int64_t>(0, shape_.refresh.newest(first_step) - shape_.pool + 1);
  next_place_ = shape_.places;
  for (int i = 0; i < std::max(shape_.makers, 1); ++i) threads_.emplace_back([this] { work(); });
}

ExamplePool::ExamplePool(Maker maker, const PoolShape& shape, std::uint64_t seed)
    : maker_(std::move(maker)), shape_(shape), seed_(seed) {}

ExamplePool::~ExamplePool() {
  {
    const std::lock_guard lock(mutex_);
    stop_ = true;
  }
  changed_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

// As far as the pool reaches, while the pace is measured for the first time.
std::int64_t ExamplePool::newest_wanted(std::int64_t step) const {
  const std::int64_t room = std::max<std::int64_t>(shape_.pool - 1, kGenerationsAhead);
  return shape_.refresh.newest(step) + (shape_.refresh.per_step > 0 ? kGenerationsAhead : room);
}

bool ExamplePool::refresh_is_due(std::int64_t step) const {
  const Refresh& now = shape_.refresh;
  return pace_.steps >= kMeasuringSteps && step >= (now.per_step > 0 ? 2 * now.from : now.from);
}

double ExamplePool::measured_refresh() const {
  const std::lock_guard lock(mutex_);
  const double steps_s = pace_.since.seconds() - (waiting_s_ - pace_.waited_s) - pace_.left_out_s;
  const double step_s = steps_s / (pace_.steps + 1 - kSettlingSteps);
  const double examples_per_s = std::max(shape_.makers, 1) * pace_.examples / pace_.making_s;
  return std::clamp(kShareOfPace * examples_per_s * step_s / shape_.places, 1e-4, 1.0);
}

void ExamplePool::leave_out(double seconds) {
  const std::lock_guard lock(mutex_);
  pace_.left_out_s += seconds;
}

void ExamplePool::set_refresh(const Refresh& refresh) {
  const std::lock_guard lock(mutex_);
  shape_.refresh = refresh;
  // The makers may have nothing to do for a while: what they have shown counts on, for less.
  pace_ = {.examples = pace_.examples / 4, .making_s = pace_.making_s / 4};
}

void ExamplePool::work() {
  std::optional<SerialLoops> alone;  // several makers are enough for all cores
  if (shape_.makers > 1) alone.emplace();
  std::unique_lock lock(mutex_);
  try {
    while (!stop_ && !failure_) {
      const std::int64_t end = first_generation_ + static_cast<std::int64_t>(generations_.size());
      if (next_place_ == shape_.places && end <= wanted_) {
        generations_.push_back(
            {std::vector<TrainingExample>(static_cast<std::size_t>(shape_.places)), shape_.places});
        next_place_ = 0;
      }
      if (next_place_ < shape_.places)
        make_next(lock);
      else
        changed_.wait(lock);
    }
  } catch (...) {  // handed to whoever waits
    if (!lock.owns_lock()) lock.lock();
    failure_ = std::current_exception();
    changed_.notify_all();
  }
}

// The next example of the last generation, made while the lock is open.
void ExamplePool::make_next(std::unique_lock<std::mutex>& lock) {
  const std::int64_t number =
      first_generation_ + static_cast<std::int64_t>(generations_.size()) - 1;
  const int place = next_place_++;
  lock.unlock();
  const Stopwatch stopwatch;
  TrainingExample made =
      maker_(static_cast<std::uint32_t>(number * shape_.batch + shape_.first_place + place));
  lock.lock();
  ++pace_.examples;
  pace_.making_s += stopwatch.seconds();
  // Steps that leap may have left the generation behind meanwhile.
  if (number < first_generation_) return;
  Generation& generation = generations_[static_cast<std::size_t>(number - first_generation_)];
  generation.examples[static_cast<std::size_t>(place)] = std::move(made);
  if (--generation.missing == 0) changed_.notify_all();
}

bool ExamplePool::complete(std::int64_t generation) const {
  const std::int64_t at = generation - first_generation_;
  return at < static_cast<std::int64_t>(generations_.size()) &&
         generations_[static_cast<std::size_t>(at)].missing == 0;
}

TrainingExample ExamplePool::batch(std::int64_t step) {
  const std::int64_t newest = shape_.refresh.newest(step);
  const std::int64_t oldest = std::max<std::int64_t>(0, newest - shape_.pool + 1);
  std::unique_lock lock(mutex_);
  wanted_ = newest_wanted(step);
  if (++pace_.steps == kSettlingSteps) {
    pace_.since = {};
    pace_.waited_s = waiting_s_;
    pace_.left_out_s = 0;
  }
  // The last one stays: it may be in the making.
  for (; first_generation_ < oldest && generations_.size() > 1; ++first_generation_)
    generations_.pop_front();
  changed_.notify_all();
  const Stopwatch stopwatch;
  changed_.wait(lock, [&] {
    if (failure_) return true;
    for (std::int64_t g = std::max(oldest, first_generation_); g <= newest; ++g)
      if (!complete(g)) return false;
    return true;
  });
  waiting_s_ += stopwatch.seconds();
  if (failure_) std::rethrow_exception(failure_);
  std::vector<torch::Tensor> inputs, targets;
  for (int place = 0; place < shape_.places; ++place) {
    RandomSequence random(seed_, static_cast<std::uint32_t>(step), Draw::kOther,
                          static_cast<std::uint64_t>(shape_.first_place + place));
    const std::int64_t generation = oldest + pick(random, newest - oldest + 1);
    const TrainingExample& example =
        generations_[static_cast<std::size_t>(generation - first_generation_)]
            .examples[static_cast<std::size_t>(place)];
    const std::int64_t rows = example.input.size(1), cols = example.input.size(2);
    if (rows < shape_.patch_rows || cols < shape_.patch_cols)
      throw InputError(example.source.empty() ? "an example" : example.source,
                       fmt::format("has planes of {} x {}, a step of the training takes {} x {}",
                                   cols, rows, shape_.patch_cols, shape_.patch_rows),
                       "set a smaller patch in [data] (it counts mosaic pixels), or take larger "
                       "pictures");
    const std::int64_t row0 = pick(random, rows - shape_.patch_rows + 1);
    const std::int64_t col0 = pick(random, cols - shape_.patch_cols + 1);
    const auto cut = [&](const torch::Tensor& planes) {
      const std::int64_t scale = planes.size(1) / rows;
      return planes.slice(1, scale * row0, scale * (row0 + shape_.patch_rows))
          .slice(2, scale * col0, scale * (col0 + shape_.patch_cols));
    };
    inputs.push_back(cut(example.input));
    targets.push_back(cut(example.target));
  }
  return {torch::stack(inputs), torch::stack(targets)};
}

Refresh first_refresh(const TrainingConfig& config, const Refresh& known, std::int64_t step) {
  if (config.data.refresh > 0) return {config.data.refresh};
  return known.per_step > 0 ? known : Refresh{0, step + ExamplePool::kMeasuringSteps};
}

Refresh settled_refresh(ExamplePool& pool, std::int64_t step, Workers& workers,
                        const torch::Device& device) {
  torch::Tensor measured =
      torch::full({}, pool.measured_refresh(), torch::dtype(torch::kFloat64).device(device));
  workers.sum(measured);
  const Refresh refresh{measured.item<double>() / workers.size(), step,
                        pool.refresh().newest(step)};
  pool.set_refresh(refresh);
  return refresh;
}

}  // namespace malus
