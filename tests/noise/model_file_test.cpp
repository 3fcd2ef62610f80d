#include "malus/base/error.h"
#include "malus/noise/fixed_pattern.h"
#include "malus/noise/model.h"

#include <csignal>
#include <cstdint>
#include <ctime>
#include <fstream>
#include <iterator>
#include <limits>

#include "../problem_of.h"
#include "sample_model.h"
#include "support.h"
#include <gmock/gmock.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

// The leak sanitizer asks for this: on damaged files HDF5 itself loses some memory.
extern "C" const char* __lsan_default_suppressions() {  // NOLINT: the sanitizer's name
  return "leak:libhdf5";
}

namespace malus {
namespace {

using testing::TemporaryFolder;

std::string bytes_of(const std::filesystem::path& path) {
  std::ifstream in(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

void write_bytes(const std::filesystem::path& path, const std::string& bytes) {
  std::ofstream(path, std::ios::binary) << bytes;
}

TEST(ModelFile, KeepsEveryField) {
  const TemporaryFolder folder;
  const NoiseModel model = testing::full_model();
  ASSERT_EQ(contradiction_in(model), "");
  save_model(model, folder / "m.h5");
  const NoiseModel read = load_model(folder / "m.h5");
  EXPECT_EQ(read, model);
  EXPECT_EQ(read.layout.name(), model.layout.name());
}

TEST(ModelFile, KeepsAModelWithNothingOptional) {
  const TemporaryFolder folder;
  NoiseModel model = testing::full_model();
  PhysicsCalibration bare;
  bare.mu.mean = {0.0, 0.1};
  bare.sigma_tl.mean = {1.0, 1.1};
  bare.lambda.mean = {0.14, 0.14};
  model.physics = {bare};
  model.joint.reset();
  model.gaussian.clear();
  model.nonparametric.clear();
  model.dark_frames.clear();
  model.defects.clear();
  save_model(model, folder / "m.h5");
  EXPECT_EQ(load_model(folder / "m.h5"), model);
}

// As many as calibration lists of small frames (most_defects in calibrate/internal/defects.h).
TEST(ModelFile, KeepsALongListOfDefects) {
  const TemporaryFolder folder;
  NoiseModel model = load_model("imx250myr-simulated");
  for (int i = 0; i < 100000; ++i) model.defects.push_back({i / 2448, i % 2448, "hot", 9.0});
  save_model(model, folder / "m.h5");
  EXPECT_EQ(load_model(folder / "m.h5"), model);
}

TEST(ModelFile, WhatReadingWouldRefuseIsNotWritten) {
  const TemporaryFolder folder;
  const auto refused = [&](const NoiseModel& model) {
    const std::string problem = testing::problem_of([&] { save_model(model, folder / "m.h5"); });
    EXPECT_FALSE(std::filesystem::exists(folder / "m.h5"));
    return problem;
  };
  NoiseModel many = testing::full_model();
  many.gaussian.assign(1000, many.gaussian.at(0));
  for (std::size_t i = 0; i < many.gaussian.size(); ++i)
    many.gaussian[i].gain.gain_db = 0.01 * static_cast<double>(i);
  EXPECT_THAT(refused(many),
              ::testing::HasSubstr("gaussian has 1000 values, more than a model file holds"));
  NoiseModel large = testing::full_model();
  NonparametricChannel& channel = large.nonparametric.at(0).channels.at(0);
  constexpr std::size_t kLevels = 4096, kBins = 4097;
  channel = {};
  for (std::size_t i = 0; i < kLevels; ++i) channel.level_dn.push_back(static_cast<double>(i));
  for (std::size_t i = 0; i <= kBins; ++i) channel.bin_edges_dn.push_back(static_cast<double>(i));
  channel.samples.assign(kLevels, 1000);
  channel.pmf.assign(kLevels, std::vector<double>(kBins, 1.0 / kBins));
  EXPECT_THAT(refused(large), ::testing::HasSubstr("channels/000/pmf has 4096 x 4097 values"));
}

TEST(ModelFile, NamedLayoutsKeepTheirName) {
  const TemporaryFolder folder;
  NoiseModel model = load_model("imx250myr-simulated");
  save_model(model, folder / "m.h5");
  EXPECT_EQ(load_model(folder / "m.h5"), model);
  EXPECT_EQ(load_model(folder / "m.h5").layout.name(), "polar-bayer-rggb");
}

TEST(ModelFile, SameModelSameBytes) {
  const TemporaryFolder folder;
  const std::time_t begin = std::time(nullptr);
  save_model(testing::full_model(), folder / "a.h5");
  save_model(testing::full_model(), folder / "b.h5");
  const std::string bytes = bytes_of(folder / "a.h5");
  EXPECT_EQ(bytes, bytes_of(folder / "b.h5"));
  // HDF5 would note the second that it is, in four bytes.
  for (std::time_t second = begin; second <= std::time(nullptr); ++second) {
    const auto noted = static_cast<std::uint32_t>(second);
    EXPECT_EQ(bytes.find(std::string(reinterpret_cast<const char*>(&noted), sizeof noted)),
              std::string::npos);
  }
}

TEST(ModelFile, NeedsForceToReplace) {
  const TemporaryFolder folder;
  save_model(testing::full_model(), folder / "m.h5");
  EXPECT_THROW(save_model(testing::full_model(), folder / "m.h5"), InputError);
  EXPECT_NO_THROW(save_model(testing::full_model(), folder / "m.h5", true));
}

// A file cut at any length is refused; one byte changed is refused or changes nothing that is read.
TEST(ModelFile, RefusesTruncation) {
  const TemporaryFolder folder;
  save_model(testing::full_model(), folder / "m.h5");
  const std::string whole = bytes_of(folder / "m.h5");
  for (std::size_t length :
       {std::size_t{0}, std::size_t{7}, std::size_t{100}, whole.size() / 2, whole.size() - 1}) {
    write_bytes(folder / "cut.h5", whole.substr(0, length));
    EXPECT_THROW(load_model(folder / "cut.h5"), InputError) << length;
  }
}

TEST(ModelFile, ADamagedByteNeverChangesWhatIsRead) {
  const TemporaryFolder folder;
  const NoiseModel model = testing::full_model();
  save_model(model, folder / "m.h5");
  const std::string whole = bytes_of(folder / "m.h5");
  int refused = 0, harmless = 0;
  for (std::size_t i = 0; i < whole.size(); i += 1009) {
    std::string damaged = whole;
    damaged[i] = static_cast<char>(damaged[i] ^ 0x5A);
    write_bytes(folder / "damaged.h5", damaged);
    try {
      EXPECT_TRUE(load_model(folder / "damaged.h5") == model) << "byte " << i;
      ++harmless;
    } catch (const InputError&) {
      ++refused;
    }
  }
  EXPECT_GT(refused, harmless / 4);
}

TEST(ModelFile, RefusesWhatIsNoModel) {
  const TemporaryFolder folder;
  EXPECT_THROW(load_model(folder / "absent.h5"), InputError);
  EXPECT_THROW(load_model(folder.path()), InputError);
  write_bytes(folder / "text.h5", "not a model");
  EXPECT_THROW(load_model(folder / "text.h5"), InputError);
}

TEST(ModelFile, RefusesContradictions) {
  const auto problem_after = [](auto change) {
    NoiseModel model = testing::full_model();
    change(model);
    return contradiction_in(model);
  };
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].K.mean[0] = -1; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].mu.mean.pop_back(); }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].lambda.mean[1] = -0.6; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].lambda.mean[1] = 132; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].sigma_tl.mean[1] = -0.1; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].sigma_row.mean[1] = -0.1; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { std::swap(m.physics[0], m.physics[1]); }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].gain = {{}, 100.0}; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].mu.covariance(0, 1) = 9; }), "");
  EXPECT_EQ(problem_after([](NoiseModel& m) {  // rounding about zero is no asymmetry
              m.physics[1].mu.covariance = testing::matrix2(1.0, 1e-17, 1.0);
              m.physics[1].mu.covariance(1, 0) = 0;
            }),
            "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[1].transfer[0].channel = 2; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[0].sigma_tl.mean[0] = NAN; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.black_dn[0] = 5000; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.saturation_limit = NAN; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.row_group = 0; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.physics[0].row_drift.drift.share = 1.2; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.nonparametric[0].row_drift.length_stderr = -1; }),
            "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.joint->segments[0].row_drift.pop_back(); }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.joint->segments[0].lambda.pop_back(); }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.joint->segments[0].knots_db[1] = -1; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.gaussian[0].slope_dn = {1.0}; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.gaussian[0].slope_dn[1] = -0.001; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.nonparametric[0].channels[0].pmf[0][0] = 0.9; }),
            "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.nonparametric[0].channels.pop_back(); }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.nonparametric[0].sigma_row_dn[1] = -0.1; }), "");
  EXPECT_NE(problem_after([](NoiseModel& m) { m.dark_frames[0].frames_dn[0] = Image(4, 5); }), "");
  for (const float value : {NAN, std::numeric_limits<float>::infinity()})
    EXPECT_NE(problem_after([=](NoiseModel& m) { m.dark_frames[0].frames_dn[1](3, 5) = value; }),
              "");
}

// What is drawn between the measured gains is as possible as what is drawn at them.
TEST(ModelFile, RefusesJointModelsThatGiveNoNoise) {
  const auto problem_after = [](auto change) {
    NoiseModel model = testing::full_model();
    change(model.joint->segments);
    return contradiction_in(model);
  };
  for (const double lambda : {-0.6, 1e6})
    EXPECT_NE(problem_after([&](auto& s) { s[0].lambda[1][0] = lambda; }), "");
  for (const double ratio : {-1.0, 0.0})
    EXPECT_NE(problem_after([&](auto& s) { s[0].K_ratio[1] = ratio; }), "");
  for (const double intercept : {2000.0, -2000.0})
    EXPECT_NE(problem_after([&](auto& s) { s[0].K_of_gain.intercept = intercept; }), "");
  EXPECT_NE(problem_after([](auto& s) { s[0].sigma_tl[1].intercept = 2000; }), "");
  EXPECT_NE(problem_after([](auto& s) {
              s[0].mu_variance[0].signed_linear = true;
              s[0].mu_variance[0].intercept = -1000;
            }),
            "");
  EXPECT_NE(problem_after([](auto& s) { s.push_back(s[0]); }), "");
}

// What plots and sums of a model rest on: a number in every pixel and point, cells of some width.
TEST(ModelFile, RefusesMapsPointsAndCountsThatAreNoNumbers) {
  const auto problem_after = [](auto change) {
    NoiseModel model = testing::full_model();
    change(model.physics[1]);
    return contradiction_in(model);
  };
  const float infinity = std::numeric_limits<float>::infinity();
  EXPECT_NE(problem_after([](auto& p) { p.dark_shading_dn(129, 61) = NAN; }), "");
  EXPECT_NE(problem_after([&](auto& p) { p.prnu_map(0, 0) = infinity; }), "");
  EXPECT_NE(problem_after([](auto& p) { p.transfer[1].mean_dn = NAN; }), "");
  EXPECT_NE(problem_after([](auto& p) { p.transfer[1].variance_dn2 = NAN; }), "");
  EXPECT_NE(problem_after([&](auto& p) { p.transfer[1].exposure_s = infinity; }), "");
  EXPECT_EQ(problem_after([](auto& p) {  // not known
              p.transfer[1].exposure_s = p.transfer[1].variance_stderr_dn2 = NAN;
            }),
            "");
  for (const double width : {0.0, -0.1, static_cast<double>(NAN)})
    EXPECT_NE(problem_after([&](auto& p) { p.residual_cell_dn[1] = width; }), "");
  EXPECT_NE(problem_after([](auto& p) { p.residual_counts[1][2] = -1; }), "");
}

// A model that somebody edited: what is squared would hide its sign, what is drawn would be no
// noise.
TEST(ModelFile, RefusesDeviationsThatAreNone) {
  const auto problem_after = [](auto change) {
    NoiseModel model = testing::full_model();
    change(model, model.physics[1]);
    return contradiction_in(model);
  };
  const double infinity = std::numeric_limits<double>::infinity();
  for (const double value : {-0.1, infinity, 1e30}) {
    EXPECT_NE(problem_after([&](auto&, auto& p) { p.dsnu_dn = {value, 1}; }), "") << value;
    EXPECT_NE(problem_after([&](auto&, auto& p) { p.prnu = {0.01, value}; }), "") << value;
    EXPECT_NE(problem_after([&](auto&, auto& p) { p.temporal_sd_dark_dn = {value, 1}; }), "");
    EXPECT_NE(problem_after([&](auto&, auto& p) { p.sigma_column.mean = {1, value}; }), "");
    EXPECT_NE(problem_after([&](auto&, auto& p) { p.sigma_tl.spread = {1, value}; }), "");
    EXPECT_NE(problem_after([&](auto&, auto& p) { p.sigma_tl.mean = {1, value}; }), "");
    EXPECT_NE(problem_after([&](auto&, auto& p) { p.K.mean = {1, value}; }), "");
    EXPECT_NE(problem_after([&](auto& m, auto&) { m.quantization_dn = value; }), "");
  }
  EXPECT_EQ(problem_after([](auto&, auto& p) {  // not known
              p.dsnu_dn = p.prnu = p.sigma_tl.spread = p.mu.standard_error = {NAN, 0.01};
            }),
            "");
  EXPECT_NE(problem_after([](auto&, auto& p) { p.bias_frames = -5; }), "");
  EXPECT_NE(problem_after([](auto& m, auto&) { m.white_dn = 1e30; }), "");
  EXPECT_NE(problem_after([](auto& m, auto&) { m.joint->segments[0].knots_log_K[1] = 1e9; }), "");
}

TEST(ModelFile, RefusesCovariancesThatNoChannelsHave) {
  const auto problem_after = [](auto change) {
    NoiseModel model = testing::full_model();
    change(model);
    return contradiction_in(model);
  };
  const auto covariance = [&](double own, double shared, double other) {
    return problem_after(
        [&](NoiseModel& m) { m.physics[1].mu.covariance = testing::matrix2(own, shared, other); });
  };
  EXPECT_EQ(covariance(4, 2, 1), "");
  EXPECT_EQ(covariance(4, 2 + 1e-9, 1), "");  // rounding
  EXPECT_EQ(covariance(0, 0, 1), "");
  EXPECT_NE(covariance(4, 2.1, 1), "");
  EXPECT_NE(covariance(-1, 0, 1), "");
  EXPECT_NE(covariance(1e30, 0, 1), "");
  const auto correlation = [&](double own, double shared) {
    return problem_after([&](NoiseModel& m) {
      m.joint->segments[0].mu_correlation = testing::matrix2(own, shared, 1);
    });
  };
  for (const double shared : {1.5, -1.5}) EXPECT_NE(correlation(1, shared), "");
  EXPECT_NE(correlation(1e30, 0), "");
  EXPECT_EQ(correlation(1, -1), "");
}

// Defects of a model with maps are written over in copies of these.
TEST(ModelFile, DefectsLieInsideEveryMap) {
  const auto with_defect = [](int row, int col) {
    NoiseModel model = testing::full_model();
    model.defects.push_back({row, col, "hot", 9.0});
    return model;
  };
  const NoiseModel corner = with_defect(129, 61);
  ASSERT_EQ(contradiction_in(corner), "");
  EXPECT_EQ(fixed_pattern_at(corner, testing::db(6))->dark_dn(129, 61), 0.0F);
  EXPECT_EQ(corner.profile_at(testing::db(6)).defects.places.size(), 3u);
  for (const auto& [row, col] : {std::pair{130, 5}, {140, 5}, {1048000, 5}, {5, 62}, {-1, 5}})
    EXPECT_NE(contradiction_in(with_defect(row, col)), "") << row << ", " << col;
  NoiseModel model = testing::full_model();
  model.physics[2].prnu_map = Image(130, 64, 1.0F);
  EXPECT_NE(contradiction_in(model), "");
  model = with_defect(140, 5);
  for (PhysicsCalibration& p : model.physics) p.dark_shading_dn = p.prnu_map = Image();
  EXPECT_EQ(contradiction_in(model), "");  // of a sensor whose size is not known
  EXPECT_EQ(fixed_pattern_at(model, testing::db(6)), nullptr);
  EXPECT_EQ(model.profile_at(testing::db(6)).defects.places.size(), 0u);
}

// A child may write 20 kB: the disk is "full". It must say so and leave nothing.
TEST(ModelFile, AFullDiskLeavesNothing) {
  const TemporaryFolder folder;
  const pid_t child = fork();
  if (child == 0) {
    const rlimit limit{20000, 20000};
    setrlimit(RLIMIT_FSIZE, &limit);
    std::signal(SIGXFSZ, SIG_IGN);
    try {
      save_model(testing::full_model(), folder / "m.h5");
    } catch (const InputError&) {
      _exit(42);
    }
    _exit(1);
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  EXPECT_EQ(WEXITSTATUS(status), 42);
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace malus
