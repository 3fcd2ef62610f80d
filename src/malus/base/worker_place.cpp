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
    if (error != std::errc() || stop != end || value < 0 || value > 65535)
      throw InputError(fmt::format("{}={}", name, text), "is not a number from 0 to 65535",
                       "unset it, or start with torchrun, mpirun or srun");
    return value;
  }
  return otherwise;
}

WorkerPlace worker_place_of_environment() {
  return {
      number_of_environment({"RANK", "OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID"}, 0),
      number_of_environment({"WORLD_SIZE", "OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_NTASKS"}, 1)};
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
