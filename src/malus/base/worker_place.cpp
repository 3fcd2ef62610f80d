#include "malus/base/worker_place.h"

#include "malus/base/error.h"

#include <charconv>
#include <cstdlib>
#include <cstring>

#include <fmt/format.h>

namespace malus {

int number_of_environment(std::initializer_list<const char*> names, int otherwise) {
  for (const char* name : names) {
    const char* text = std::getenv(name);
    if (text == nullptr) continue;
    int value = 0;
    const char* end = text + std::strlen(text);
    const auto [stop, error] = std::from_chars(text, end, value);
    if (error != std::errc() || stop != end || value < 0 || value > kMostWorkers)
      throw InputError(fmt::format("{}={}", name, text),
                       fmt::format("is not a number from 0 to {}", kMostWorkers),
                       "unset it, or start with torchrun, mpirun or srun");
    return value;
  }
  return otherwise;
}

WorkerPlace worker_place_of_environment() {
  struct Names {
    const char *rank, *size;
    bool may_lack_one;  // where the other tells of one process
  };
  // Of Slurm's two, a shell of salloc has the number of tasks alone, a batch script without -n the
  // rank alone.
  constexpr Names kLaunchers[] = {{"RANK", "WORLD_SIZE", false},
                                  {"OMPI_COMM_WORLD_RANK", "OMPI_COMM_WORLD_SIZE", false},
                                  {"PMI_RANK", "PMI_SIZE", false},
                                  {"SLURM_PROCID", "SLURM_NTASKS", true}};
  for (const Names& names : kLaunchers) {
    const bool has_rank = std::getenv(names.rank) != nullptr;
    const bool has_size = std::getenv(names.size) != nullptr;
    if (!has_rank && !has_size) continue;
    const WorkerPlace place{number_of_environment({names.rank}, 0),
                            number_of_environment({names.size}, 1)};
    const bool alone = place.rank == 0 && place.size == 1;
    if (has_rank != has_size && !(alone && names.may_lack_one))
      throw InputError(fmt::format("{}={}", has_rank ? names.rank : names.size,
                                   has_rank ? place.rank : place.size),
                       fmt::format("is set, but {} is not", has_rank ? names.size : names.rank),
                       "set both or none, or start with torchrun, mpirun or srun");
    return place;
  }
  return {};
}

int local_rank_of_environment() {
  return number_of_environment(
      {"LOCAL_RANK", "OMPI_COMM_WORLD_LOCAL_RANK", "MPI_LOCALRANKID", "SLURM_LOCALID"}, 0);
}

void require_place(const WorkerPlace& place, const char* remedy) {
  if (place.size < 1 || place.rank < 0 || place.rank >= place.size)
    throw InputError(fmt::format("worker {} of {}", place.rank, place.size), "does not exist",
                     remedy);
}

}  // namespace malus
