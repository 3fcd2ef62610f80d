#include "malus/base/worker_place.h"

#include "malus/base/error.h"

#include <cstdlib>
#include <string>

#include "support.h"
#include <gmock/gmock.h>

namespace malus {
namespace {

using ::testing::HasSubstr;
using ::testing::ThrowsMessage;

class WorkerPlaces : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* name :
         {"RANK", "OMPI_COMM_WORLD_RANK", "PMI_RANK", "SLURM_PROCID", "WORLD_SIZE",
          "OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "SLURM_NTASKS", "LOCAL_RANK",
          "OMPI_COMM_WORLD_LOCAL_RANK", "MPI_LOCALRANKID", "SLURM_LOCALID"})
      unsetenv(name);
  }
  void TearDown() override { SetUp(); }
  static void set(const char* name, const char* value) { setenv(name, value, 1); }
};

TEST_F(WorkerPlaces, AloneWhereNothingIsSaid) {
  const WorkerPlace place = worker_place_of_environment();
  EXPECT_EQ(place.rank, 0);
  EXPECT_EQ(place.size, 1);
}

TEST_F(WorkerPlaces, LocalRankIsThatOfTheMachine) {
  EXPECT_EQ(local_rank_of_environment(), 0);
  set("SLURM_LOCALID", "3");
  EXPECT_EQ(local_rank_of_environment(), 3);
  set("LOCAL_RANK", "1");
  EXPECT_EQ(local_rank_of_environment(), 1);
  set("LOCAL_RANK", "first");
  EXPECT_THROW(local_rank_of_environment(), InputError);
}

TEST_F(WorkerPlaces, TorchrunGoesBeforeTheClusterItRunsIn) {
  set("SLURM_PROCID", "5");
  set("SLURM_NTASKS", "6");
  EXPECT_EQ(worker_place_of_environment().rank, 5);
  set("RANK", "1");
  set("WORLD_SIZE", "2");
  EXPECT_EQ(worker_place_of_environment().rank, 1);
  EXPECT_EQ(worker_place_of_environment().size, 2);
}

TEST_F(WorkerPlaces, WhatIsNoNumberIsNamed) {
  for (const char* text : {"", "first", "2x", "-1", "65536", "99999999999"}) {
    set("RANK", text);
    EXPECT_THAT([] { worker_place_of_environment(); },
                ThrowsMessage<InputError>(HasSubstr("RANK=")))
        << text;
  }
}

TEST_F(WorkerPlaces, OneOfAPairNamesTheOther) {
  const auto missing = [](const char* given, const char* value, const std::string& other) {
    set(given, value);
    EXPECT_THAT([] { worker_place_of_environment(); },
                ThrowsMessage<InputError>(HasSubstr("is set, but " + other + " is not")))
        << given;
    unsetenv(given);
  };
  missing("RANK", "0", "WORLD_SIZE");
  missing("WORLD_SIZE", "2", "RANK");
  missing("OMPI_COMM_WORLD_RANK", "1", "OMPI_COMM_WORLD_SIZE");
  missing("PMI_SIZE", "2", "PMI_RANK");
  missing("SLURM_NTASKS", "4", "SLURM_PROCID");
  missing("SLURM_PROCID", "1", "SLURM_NTASKS");
}

TEST_F(WorkerPlaces, ShellsOfSlurmAreOneProcess) {
  set("SLURM_PROCID", "0");
  EXPECT_EQ(worker_place_of_environment().size, 1);
  unsetenv("SLURM_PROCID");
  set("SLURM_NTASKS", "1");
  EXPECT_EQ(worker_place_of_environment().rank, 0);
}

TEST_F(WorkerPlaces, PlacesThatDoNotExistAreRefused) {
  EXPECT_NO_THROW(require_place({1, 2}, "count from 0"));
  for (const WorkerPlace place : {WorkerPlace{2, 2}, WorkerPlace{-1, 2}, WorkerPlace{0, 0}})
    EXPECT_THAT([&] { require_place(place, "count from 0"); },
                ThrowsMessage<InputError>(HasSubstr("does not exist; count from 0")));
}

}  // namespace
}  // namespace malus
