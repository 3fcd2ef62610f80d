// A Noise Flow's training as its configuration and files describe it.
#include "malus/base/random.h"
#include "malus/io/pair_list.h"
#include "malus/io/picture_file.h"
#include "malus/neural/noise_flow_training.h"
#include "malus/noise/model.h"

#include <algorithm>
#include <cmath>
#include <fstream>
#include <string>

#include "problem_of.h"
#include "support.h"
#include <gtest/gtest.h>

namespace malus {
namespace {

using testing::problem_of;

// A recorded frame of whole numbers and a clean one of floats, two steps of training.
struct RecordedFlow {
  RecordedFlow() {
    SaveOptions integers;
    integers.type = SampleType::kUint16;
    Image codes(96, 96), clean_dn(96, 96);
    RandomSequence random(8, 0, Draw::kScene);
    for (int r = 0; r < 96; ++r)
      for (int c = 0; c < 96; ++c) {
        const double signal = 20.0 + 9.0 * c;
        clean_dn(r, c) = static_cast<float>(signal);
        const double noisy = signal + std::sqrt(2.5 * signal + 30) * random.normal();
        codes(r, c) = static_cast<float>(4 * std::round(noisy / 4 + 25));
      }
    save_picture(folder / "noisy.npy", codes, integers);
    save_picture(folder / "clean.npy", clean_dn);
  }
  void write(const std::string& black, const std::string& noisy) const {
    std::ofstream(folder / "flow.toml")
        << "[network]\narchitecture = \"noise-flow\"\n[sensor]\nlayout = \"bayer-rggb\"\n"
        << "black = " << black << "\nwhite = 4095\n[[pairs]]\nnoisy = " << noisy
        << "\nclean = \"clean.npy\"\ngain_db = 12\n[train]\nsteps = 2\ncouplings = 0\n";
  }
  NoiseFlowFit train(const std::string& black, const std::string& noisy) const {
    write(black, noisy);
    return train_noise_flow(load_noise_flow_config(folder / "flow.toml"), 0);
  }
  testing::TemporaryFolder folder;
};

TEST(NoiseFlow, RecordedIntegersAreKnownWhateverTheBlack) {
  const RecordedFlow flow;
  for (const char* black : {"100", "100.25", "[100, 99.5, 100, 100.5]"})
    EXPECT_EQ(flow.train(black, "\"noisy.npy\"").model.sensor().spread_dn, 4) << black;
}

TEST(NoiseFlow, APairsMistakesAreToldWithTheirPlace) {
  const RecordedFlow flow;
  const auto problem = [&](const char* settings) {
    std::ofstream(flow.folder / "flow.toml")
        << "[network]\narchitecture = \"noise-flow\"\n[sensor]\nlayout = \"bayer-rggb\"\n"
        << "black = 100\nwhite = 4095\n[[pairs]]\nnoisy = \"noisy.npy\"\n"
        << settings;
    return problem_of([&] { load_noise_flow_config(flow.folder / "flow.toml"); });
  };
  EXPECT_EQ(problem("clean = \"clean.npy\"\niso = 400\n"), "");
  const std::string both = problem("clean = \"clean.npy\"\ngain_db = 12\niso = 400\n");
  EXPECT_NE(both.find("flow.toml:11: iso in "), std::string::npos) << both;
  const std::string missing = problem("clean = \"cleen.npy\"\ngain_db = 12\n");
  EXPECT_NE(missing.find("flow.toml:9: clean in "), std::string::npos) << missing;
}

TEST(NoiseFlow, AStackCountsAsItsFrames) {
  const RecordedFlow flow;
  const Planes frame = load_picture(flow.folder / "noisy.npy").planes;
  Planes frames(3, frame.rows(), frame.cols());
  for (Image& one : frames) one = frame[0];
  SaveOptions integers;
  integers.type = SampleType::kUint16;
  save_picture(flow.folder / "stack.npy", frames, {}, integers);
  const auto config_of = [&](const char* noisy) {
    flow.write("100", noisy);
    return load_noise_flow_config(flow.folder / "flow.toml");
  };
  const auto all = config_of("\"st*.npy\"").pairs;
  ASSERT_EQ(all.size(), 3u);
  EXPECT_EQ(all[2].noisy, flow.folder / "stack.npy[2]");
  const NoiseFlowConfig one = config_of("\"stack.npy[1]\"");
  ASSERT_EQ(one.pairs.size(), 1u);
  EXPECT_EQ(one.pairs[0].noisy, flow.folder / "stack.npy[1]");
  EXPECT_NE(config_json(one)["contents"], config_json(config_of("\"stack.npy[2]\""))["contents"]);
  EXPECT_EQ(flow.train("100", "\"stack.npy\"").model.sensor().spread_dn, 4);
}

// How bright a place at white was is not known: whatever its files say, the flow is the same.
TEST(NoiseFlow, PixelsAtWhiteAreNotLearntFrom) {
  const RecordedFlow flow;
  const Image clean_dn = load_picture(flow.folder / "clean.npy").planes[0];
  SaveOptions again;
  again.force = true;
  const auto learnt = [&](float corner_dn, int size) {
    Image other = clean_dn;
    for (int r = 0; r < size; ++r) std::fill_n(other.row(r), size, corner_dn);
    save_picture(flow.folder / "clean.npy", other, again);
    return flow.train("100", "\"noisy.npy\"").record["log"].dump();
  };
  EXPECT_EQ(learnt(3995, 20), learnt(6000, 20));
  EXPECT_NE(learnt(3900, 20), learnt(6000, 20));
  const std::string problem = problem_of([&] { learnt(3995, clean_dn.rows() - 8); });
  EXPECT_NE(problem.find("leaves no crop of 24 pixels"), std::string::npos) << problem;
}

// A sensor's hot pixels may lie above its nominal white: where few do, the others are learnt from.
TEST(NoiseFlow, HotPixelsAboveWhiteAreLeftOutAndAWrongWhiteIsRefused) {
  const RecordedFlow flow;
  SaveOptions integers;
  integers.type = SampleType::kUint16;
  integers.force = true;
  Image codes = load_picture(flow.folder / "noisy.npy").planes[0];
  const auto learnt = [&](float hot_dn, int count) {
    std::fill_n(codes.row(2), count, hot_dn);
    save_picture(flow.folder / "noisy.npy", codes, integers);
    return flow.train("100", "\"noisy.npy\"").record["log"].dump();
  };
  EXPECT_EQ(learnt(8000, 1), learnt(16000, 1));
  const std::string problem = problem_of([&] { learnt(8000, 20); });  // of 9216
  EXPECT_NE(problem.find("0.217 % of its pixels lie above the white of 4095 DN"), std::string::npos)
      << problem;
}

TEST(NoiseFlow, APatternThatMatchesNoFileIsRefused) {
  const RecordedFlow flow;
  const std::string problem = problem_of([&] { flow.train("100", R"(["noisy.npy", "nosy_*"])"); });
  EXPECT_NE(problem.find("\"nosy_*\" matches no file"), std::string::npos) << problem;
}

// The same frames as a list of one pair, of a camera that knows its sensor of 96 x 96 pixels.
struct CapturedFlow : RecordedFlow {
  CapturedFlow() {
    write("100", "\"noisy.npy\"");
    NoiseModel model = load_model("imx250mzr-simulated");
    model.physics.front().dark_shading_dn = Image(96, 96);
    model.defects = {{41, 50, "hot", 9.0}};
    save_model(model, folder / "sensor.h5");
  }
  NoiseFlowConfig config_with(const std::string& reference) const {
    save_pair_list({{.name = "dusk_00",
                     .noisy = folder / "noisy.npy",
                     .reference = folder / reference,
                     .picture = {},
                     .gain = {.gain_db = 12, .iso = {}}}},
                   folder / "pairs.json");
    return load_noise_flow_config(
        folder / "flow.toml",
        {.pairs = {folder / "pairs.json"}, .models = {folder / "sensor.h5"}, .settings = {}});
  }
  std::string log_with(const std::string& reference) const {
    return train_noise_flow(config_with(reference), 0).record["log"].dump();
  }
};

TEST(NoiseFlow, DefectsThatTheModelListsAreNotLearntFrom) {
  const CapturedFlow flow;
  SaveOptions again;
  again.force = true;
  Image clean_dn = load_picture(flow.folder / "clean.npy").planes[0];
  const auto learnt = [&](int row, float dn) {
    Image other = clean_dn;
    other(row, 50) = dn;
    save_picture(flow.folder / "clean.npy", other, again);
    return flow.log_with("clean.npy");
  };
  EXPECT_EQ(learnt(41, 500), learnt(41, 2000));
  EXPECT_NE(learnt(43, 500), learnt(43, 2000));
}

// A reference may be of another white than the sensor's, which its file tells, as other trainings
// on pairs believe it.
TEST(NoiseFlow, WhiteOfAReferenceIsThatOfItsFile) {
  const CapturedFlow flow;
  RawFrame reference;
  reference.layout = SensorLayout::named("polar-mono");
  reference.black_dn.assign(4, 0.0);
  reference.white_dn = 900;
  reference.black_known = reference.white_known = reference.layout_known = true;
  const Image clean_dn = load_picture(flow.folder / "clean.npy").planes[0];
  SaveOptions again;
  again.force = true;
  const auto learnt = [&](float corner_dn) {
    reference.dn = clean_dn;
    for (int r = 0; r < 20; ++r) std::fill_n(reference.dn.row(r), 20, corner_dn);
    save_frame(flow.folder / "reference.tif", reference, again);
    return flow.log_with("reference.tif");
  };
  EXPECT_EQ(learnt(890), learnt(2000));
  EXPECT_NE(learnt(800), learnt(2000));
}

TEST(NoiseFlow, EveryListHoldsPairs) {
  const CapturedFlow flow;
  (void)flow.config_with("clean.npy");
  save_pair_list({}, flow.folder / "empty.json");
  const std::string problem = problem_of([&] {
    load_noise_flow_config(flow.folder / "flow.toml",
                           {.pairs = {flow.folder / "pairs.json", flow.folder / "empty.json"},
                            .models = {},
                            .settings = {}});
  });
  EXPECT_NE(problem.find("empty.json: holds no pairs"), std::string::npos) << problem;
}

// Unlike a frame, whose ends tell noise from noise.
TEST(NoiseFlow, AModelIsKnownByAllThatItHolds) {
  const testing::TemporaryFolder folder;
  NoiseFlowConfig config;
  config.model = folder / "model.h5";
  const auto contents_with = [&](char middle) {
    const std::string half(1 << 17, 'a');
    std::ofstream(config.model) << half << middle << half;
    return config_json(config)["contents"].dump();
  };
  EXPECT_EQ(contents_with('b'), contents_with('b'));
  EXPECT_NE(contents_with('b'), contents_with('c'));
}

// White between the blacks of two channels leaves one of them no signal.
TEST(NoiseFlow, WhiteMustBeAboveEveryBlack) {
  const testing::TemporaryFolder folder;
  NoiseFlowSensor wrong;
  wrong.layout = "polar-mono";
  wrong.black_dn = {64, 64, 64, 2000};
  wrong.white_dn = 1023;
  NoiseFlowModel(wrong, 0, 1).save(folder / "flow.safetensors", {});
  EXPECT_NE(problem_of([&] {
              NoiseFlowModel(folder / "flow.safetensors");
            }).find("does not fit together"),
            std::string::npos);
  std::ofstream(folder / "flow.toml")
      << "[network]\narchitecture = \"noise-flow\"\n[sensor]\nlayout = \"polar-mono\"\n"
      << "black = [64, 64, 64, 2000]\nwhite = 1023\n";
  EXPECT_NE(
      problem_of([&] { load_noise_flow_config(folder / "flow.toml"); }).find("not above black"),
      std::string::npos);
}

}  // namespace
}  // namespace malus
