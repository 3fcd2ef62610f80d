#include "malus/neural/trainer.h"

#include "malus/base/error.h"
#include "malus/base/stopwatch.h"
#include "malus/base/text.h"
#include "malus/base/wording.h"
#include "malus/neural/gpu.h"
#include "malus/neural/internal/autocast.h"
#include "malus/neural/internal/checkpoint.h"
#include "malus/neural/internal/example_pool.h"
#include "malus/neural/internal/initial_network.h"
#include "malus/neural/internal/loss_watch.h"
#include "malus/neural/internal/recorded_pass.h"
#include "malus/neural/internal/run_folder.h"
#include "malus/neural/internal/run_record.h"
#include "malus/neural/internal/same_run.h"
#include "malus/neural/internal/trained_light.h"
#include "malus/neural/internal/training_log.h"
#include "malus/neural/internal/validation.h"
#include "malus/neural/internal/worker_sharing.h"
#include "malus/neural/loss.h"

#include <algorithm>
#include <cmath>

#include <c10/core/DeviceGuard.h>
#include <fmt/format.h>

namespace malus {
namespace {

using OrderedJson = nlohmann::ordered_json;
namespace fs = std::filesystem;

// What one step tells.
struct StepFigures {
  double loss = 0, base_loss = 0;  ///< base: of the guide, or of the noisy planes; NaN for pictures
  double gradient_norm = 0, rate = 0;
  bool stop = false;
};

class Trainer {
 public:
  Trainer(const TrainingConfig& config, const TrainOptions& options, Workers& workers,
          Progress& progress)
      : config_(config),
        options_(options),
        workers_(workers),
        progress_(progress),
        layout_(config.package.layout()),
        device_(training_device(config.train)),
        device_in_force_(device_),
        bfloat16_(wants_bfloat16(config)),
        description_(config_json(config)),
        network_(network_on_device()),
        pass_(
            network_->parameters(),
            [this](const TrainingExample& batch) { return losses_of(batch); },
            config.train.recorded),
        adam_(network_->parameters(), config.train.beta1, config.train.beta2),
        state_{*network_, adam_, average_},
        watch_(config.source.string()) {
    description_["seed"] = options.seed;
    for (const torch::Tensor& parameter : network_->parameters())
      average_.push_back(parameter.detach().clone());
  }

  OrderedJson run() {
    require_same_run(workers_, description_, device_);
    if (open_folder()) return finished();
    const auto source = make_pair_source(config_);
    const Validation validation(config_, options_.seed + 1, progress_);
    shares_ = source->shares();
    if (leader()) {
      warn_of_models(source->complaints(), validation.complaints());
      tell_of_steps();
    }
    if (leader() && !(state_.brightest > 0))
      state_.brightest = brightest_light(config_.package, *source, options_.seed, progress_);
    begin_log(validation);
    state_.refresh = first_refresh(config_, state_.refresh, state_.step);
    ExamplePool pool(
        [&](std::uint32_t number) {
          TrainingExample made = make_example(source->pair(options_.seed, number), config_.package);
          made.input = made.input.to(device_);
          made.target = made.target.to(device_);
          return made;
        },
        pool_shape(config_, workers_, device_.is_cuda(), state_.refresh), options_.seed,
        state_.step);
    progress_.begin("training", config_.train.steps);
    progress_.advance(state_.step);
    const double before = state_.seconds;
    const Stopwatch stopwatch;
    while (state_.step < config_.train.steps) {
      const StepFigures figures = step_or_save(pool);
      ++state_.step;
      state_.seconds = before + stopwatch.seconds();
      if (config_.data.refresh == 0 && pool.refresh_is_due(state_.step))
        state_.refresh = settled_refresh(pool, state_.step, workers_, device_);
      const Stopwatch beside;
      after_step(figures, validation, pool.waiting_s() / (state_.seconds - before));
      pool.leave_out(beside.seconds());
    }
    if (!leader()) return {{"rank", workers_.rank()}};
    if (const std::string complaint = watch_.complaint(); !complaint.empty())
      progress_.warn(complaint);
    save_package(file("weights.safetensors"));
    OrderedJson made = run_record(config_, facts(), log_->lines());
    if (!validation.empty() && !config_.package.gives_picture()) {
      const AveragedWeights in_force = averaged();
      network_->eval();
      validation.save_sample(*network_, package(), file("sample"));
      made["sample"] = sample_entry(config_, file("sample"));
    }
    return made;
  }

 private:
  bool leader() const { return workers_.rank() == 0; }
  fs::path file(const char* name) const { return options_.folder / name; }

  std::shared_ptr<Network> network_on_device() const {
    auto network = initial_network(config_, options_.seed);
    if (device_.is_cuda()) {
      choose_fast_gpu_kernels();
      place_network(*network, device_, kChannelsLast);
    }
    return network;
  }

  // Examples and validation may be taken for the same gains: that is said once.
  void warn_of_models(const std::vector<std::string>& of_examples,
                      const std::vector<std::string>& of_validation) {
    for (const std::string& line : of_examples) progress_.warn(line);
    for (const std::string& line : of_validation)
      if (std::ranges::find(of_examples, line) == of_examples.end()) progress_.warn(line);
  }

  // What follows from the configuration and may surprise.
  void tell_of_steps() {
    std::string text;
    for (const auto& [name, part] : shares_.items())
      text += fmt::format("{}{:.3g} % {}", text.empty() ? "" : ", ",
                          100 * part["share"].get<double>(), name);
    if (!text.empty()) progress_.note("of the examples are " + text);
    if (config_.train.warm_up >= config_.train.steps)
      progress_.warn(fmt::format(
          "{}: warm_up = {} is not over after the {} of the training, whose rate rises to its end",
          config_.source.string(), config_.train.warm_up, counted(config_.train.steps, "step")));
  }

  // Worker 0 alone has the folder; the others begin with what it holds. Result: whether the run it
  // holds is at its end.
  bool open_folder() {
    bool at_end = false;
    if (leader()) {
      folder_.emplace(options_.folder, options_.resume, options_.force);
      if (folder_->goes_on()) {
        load_checkpoint(state_, description_, file("checkpoint.safetensors"));
        log_.emplace(file("log.jsonl"), state_.step);
        find_best_score();
        at_end = is_finished(config_, facts(), log_->lines());
      } else if (folder_->would_remove(config_.begin_with)) {
        throw InputError(config_.begin_with.string(),
                         "lies where this run writes weights of its own",
                         "copy it elsewhere and name the copy, or train into another folder");
      }
    }
    return take_leaders_state(workers_, state_, at_end, device_);
  }

  OrderedJson finished() const {
    if (!leader()) return {{"rank", workers_.rank()}};
    return finished_record(config_, facts(), log_->lines());
  }

  // What the log tells and the checkpoint, which is saved before a validation, does not.
  void find_best_score() {
    for (const OrderedJson& line : log_->lines())
      if (line.contains("validation"))
        state_.best_score_db = std::max(state_.best_score_db, summed_db(line["validation"]));
  }

  // Of a new run: nothing that an earlier one left in the folder is taken for its own.
  void begin_log(const Validation& validation) {
    const auto told = [&](const char* key, std::int64_t step) {
      return is_told(log_->lines(), key, step);
    };
    if (leader()) {
      if (!folder_->goes_on()) {
        folder_->begin();
        log_.emplace(file("log.jsonl"), -1);
      }
      if (!validation.empty() && !told("noisy", 0)) log_start(validation);
    }
    if (state_.step == 0 || !validation_due(validation)) return;
    if (leader() && !told("validation", state_.step)) validate(validation);
    wait_for_leader();
  }

  // A step that is left because the others do not end it has changed nothing yet.
  StepFigures step_or_save(ExamplePool& pool) {
    try {
      return step(pool);
    } catch (const Cancelled&) {
      if (leader() && state_.step > 0) {
        save_checkpoint(state_, description_, file("checkpoint.safetensors"));
        say_that_it_stops();
      }
      throw;
    }
  }

  StepFigures step(ExamplePool& pool) {
    const TrainingExample batch = pool.batch(state_.step);
    const StepLosses losses = pass_(batch);
    say_if_not_recorded();
    const double stop = progress_.stop_requested() ? 1.0 : 0.0;
    torch::Tensor told =
        torch::stack({losses.loss, losses.base_loss, torch::full({}, stop, losses.loss.options())});
    const auto parameters = network_->parameters();
    told = mean_over_workers(workers_, parameters, told);
    // A GPU is waited for here and only here: reading a value of it stops the work ahead.
    StepFigures figures{.gradient_norm = clip_gradients(parameters, config_.train.clip),
                        .rate = learning_rate_at(config_.train, state_.step)};
    told = told.cpu();
    figures.loss = told[0].item<double>();
    figures.base_loss = told[1].item<double>();
    figures.stop = told[2].item<double>() > 0;
    watch_.see(figures.loss, figures.base_loss, figures.gradient_norm, state_.step,
               state_.first_loss);
    adam_.update(figures.rate, state_.step);
    update_average(average_, parameters, config_.train.average, state_.step);
    return figures;
  }

  StepLosses losses_of(const TrainingExample& batch) const {
    torch::Tensor output;
    {
      const Autocast autocast(bfloat16_, device_.is_cuda());
      output = apply_network(*network_, config_.package, batch.input).to(torch::kFloat32);
    }
    return {loss_of(batch.input, output, batch.target).to(torch::kFloat32),
            base_loss_of(batch.input, batch.target)};
  }

  void say_if_not_recorded() {
    if (pass_.refusal().empty() || told_refusal_) return;
    told_refusal_ = true;
    if (leader())
      progress_.note(fmt::format("the steps are not recorded on this GPU, which takes longer ({})",
                                 pass_.refusal()));
  }

  // A package in units of the noise has its loss in them too, or dark examples would count most.
  torch::Tensor loss_of(const torch::Tensor& input, const torch::Tensor& output,
                        const torch::Tensor& target) const {
    if (config_.package.settings.noise_input != "units")
      return training_loss(config_.train, layout_, output, target);
    const torch::Tensor level = noise_level_of(config_.package, input);
    return training_loss(config_.train, layout_, output / level, target / level);
  }

  torch::Tensor base_loss_of(const torch::Tensor& input, const torch::Tensor& target) const {
    if (config_.package.gives_picture()) return torch::full({}, std::nan(""), input.options());
    const torch::NoGradGuard no_gradients;
    return loss_of(input, input.slice(1, 0, target.size(1)), target);
  }

  void after_step(const StepFigures& figures, const Validation& validation, double waiting) {
    const TrainSettings& train = config_.train;
    const bool last = state_.step == train.steps;
    progress_.advance(1);
    if (leader() && (state_.step % train.log_every == 0 || last)) {
      OrderedJson line{{"step", state_.step}, {"loss", figures.loss}};
      if (!std::isnan(figures.base_loss)) line["base_loss"] = figures.base_loss;
      line.update({{"rate", figures.rate},
                   {"gradient_norm", figures.gradient_norm},
                   {"seconds", state_.seconds},
                   {"waiting", waiting},
                   {"refresh", state_.refresh.per_step}});
      log_->write(line);
    }
    const bool validates = validation_due(validation);
    // Before the validation, which may take long.
    if (leader() &&
        (state_.step % train.checkpoint_every == 0 || validates || last || figures.stop))
      save_checkpoint(state_, description_, file("checkpoint.safetensors"));
    const bool stops = figures.stop && !last;
    if (leader() && stops) say_that_it_stops();
    if (leader() && validates) validate(validation);
    if (stops) throw Cancelled();
    if (validates) wait_for_leader();
  }

  void say_that_it_stops() {
    progress_.note(fmt::format("{}: a checkpoint of step {} of {}; {} goes on from it",
                               options_.folder.string(), state_.step, config_.train.steps,
                               setting("resume", true)));
  }

  bool validation_due(const Validation& validation) const {
    return !validation.empty() &&
           (state_.step % config_.validation.every == 0 || state_.step == config_.train.steps);
  }

  // After work of worker 0 alone; at the end nobody needs it any more.
  void wait_for_leader() {
    if (state_.step < config_.train.steps) workers_.wait_for_leader();
  }

  void log_start(const Validation& validation) {
    OrderedJson line{{"step", 0}, {"noisy", json_of(validation.noisy_score())}};
    if (config_.package.settings.guide != "none") line["guide"] = json_of(validation.guide_score());
    log_->write(line);
  }

  // As it is used, beyond the light of training too; steps see no other light.
  NetworkPackage package() const {
    NetworkPackage package = config_.package;
    package.brightest = state_.brightest;
    return package;
  }

  AveragedWeights averaged() {
    return {network_->parameters(), average_, config_.train.average > 0};
  }

  void validate(const Validation& validation) {
    ValidationScore score;
    {
      const AveragedWeights in_force = averaged();
      network_->eval();
      // The others learn of a stop at the next step.
      score = validation.score(*network_, package(),
                               workers_.size() == 1 ? progress_ : silent_progress());
      network_->train();
    }
    const OrderedJson json = json_of(score);
    if (const double sum = summed_db(json); sum > state_.best_score_db) {
      state_.best_score_db = sum;
      save_package(file("best.safetensors"), json);
    }
    // Last: without this line the validation is made again when the run goes on.
    log_->write({{"step", state_.step}, {"validation", json}});
  }

  // validation: of these weights, where the log does not hold it yet.
  void save_package(const fs::path& path, const OrderedJson& validation = {}) {
    const AveragedWeights in_force = averaged();
    NetworkPackage package = this->package();
    package.training = training_told(config_, facts(), description_, log_->lines());
    if (!validation.is_null()) package.training["validation"] = validation;
    save_tensor_file(package_file(package, *network_), path);
  }

  RunFacts facts() const {
    return {.folder = options_.folder,
            .parameters = parameter_count(*network_),
            .steps = state_.step,
            .workers = workers_.size(),
            .device = device_.str(),
            .seconds = state_.seconds,
            .best_score_db = state_.best_score_db,
            .shares = shares_};
  }

  const TrainingConfig& config_;
  const TrainOptions& options_;
  std::optional<RunFolder> folder_;
  Workers& workers_;
  Progress& progress_;
  SensorLayout layout_;
  torch::Device device_;
  c10::DeviceGuard device_in_force_;
  bool bfloat16_;
  nlohmann::json description_;
  std::shared_ptr<Network> network_;
  RecordedPass pass_;
  bool told_refusal_ = false;
  OrderedJson shares_;  ///< PairSource::shares
  Adam adam_;
  std::vector<torch::Tensor> average_;
  TrainingState state_;
  LossWatch watch_;
  std::optional<TrainingLog> log_;
};

}  // namespace

OrderedJson train(const TrainingConfig& config, const TrainOptions& options, Workers& workers,
                  Progress& progress) {
  return Trainer(config, options, workers, progress).run();
}

}  // namespace malus
