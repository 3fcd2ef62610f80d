// Which of several processes this one is, as torchrun, mpirun or srun say in the environment.
#pragma once

#include <initializer_list>

namespace malus {

/// Of processes, and of ports: numbers of the environment and flags are no larger.
inline constexpr int kMostWorkers = 65535;

/// The first of the variables that is set, as a whole number from 0 to kMostWorkers;
/// otherwise where none is. Throws InputError, naming the variable.
int number_of_environment(std::initializer_list<const char*> names, int otherwise);

struct WorkerPlace {
  int rank = 0, size = 1;
};

/// RANK and WORLD_SIZE (torchrun), OMPI_COMM_WORLD_RANK and _SIZE or PMI_RANK and _SIZE (mpirun),
/// SLURM_PROCID and SLURM_NTASKS (srun), the first of these pairs of which one is set; {0, 1} where
/// none is. Throws InputError where a variable is no number, or one of its pair is missing.
WorkerPlace worker_place_of_environment();

/// This process among those of its machine: LOCAL_RANK (torchrun), OMPI_COMM_WORLD_LOCAL_RANK or
/// MPI_LOCALRANKID (mpirun), SLURM_LOCALID (srun); 0 where none is set. Throws InputError likewise.
int local_rank_of_environment();

/// Throws InputError where no process has that place; remedy: how the user sets it.
void require_place(const WorkerPlace& place, const char* remedy);

}  // namespace malus
