// Archives written by PyTorch itself, and what must not be believed. fuzz/make_torch_seeds.py made
// the files; those named bad_* are refused by the replay of the fuzz targets.
#include "malus/weights/torch_archive.h"

#include "malus/base/error.h"
#include "malus/weights/internal/pickle.h"
#include "malus/weights/internal/stored_zip.h"
#include "malus/weights/safetensors.h"

#include <cstring>
#include <map>

#include "problem_of.h"
#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace malus {
namespace {

using namespace std::string_literals;  // texts that hold zeros

using ::testing::ElementsAre;

std::vector<std::byte> seed(const std::string& name) {
  return read_weight_file(std::string(MALUS_SOURCE_DIR) + "/fuzz/corpus/torch_archive/" + name);
}

std::map<std::string, ArchivedTensor> weights_of(const std::vector<std::byte>& bytes) {
  std::map<std::string, ArchivedTensor> found;
  for (const ArchivedTensor& tensor : parse_torch_archive(bytes, "seed"))
    found[tensor.name] = tensor;
  return found;
}

template <class T>
std::vector<T> values_of(const ArchivedTensor& tensor) {
  std::vector<T> values(tensor.values.size() / sizeof(T));
  std::memcpy(values.data(), tensor.values.data(), tensor.values.size());
  return values;
}

Pickle unpickled(const std::string& text) {
  return parse_pickle(std::as_bytes(std::span(text)), "pickle");
}

TEST(TorchArchive, GivesTheWeightsThatPyTorchSaved) {
  for (const char* name : {"good_state.pth", "good_parallel.pth"}) {
    SCOPED_TRACE(name);
    const auto bytes = seed(name);
    auto weights = weights_of(bytes);
    ASSERT_EQ(weights.size(), 9u);
    EXPECT_EQ(weights["a.weight"].dtype, "F32");
    EXPECT_THAT(weights["a.weight"].shape, ElementsAre(3, 4));
    EXPECT_THAT(values_of<float>(weights["a.weight"]),
                ElementsAre(0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11));
    EXPECT_EQ(weights["tied"].values.data(), weights["a.weight"].values.data());
    EXPECT_EQ(weights["b"].dtype, "I64");
    EXPECT_THAT(values_of<std::int64_t>(weights["b"]), ElementsAre(0, 1, 2, 3));
    EXPECT_THAT(weights["turned"].shape, ElementsAre(3, 2));
    EXPECT_THAT(weights["turned"].stride, ElementsAre(1, 3));
    EXPECT_THAT(values_of<float>(weights["turned"]), ElementsAre(0, 1, 2, 3, 4, 5));
    EXPECT_THAT(values_of<std::uint16_t>(weights["half"]), ElementsAre(0x3800, 0xc000));
    EXPECT_EQ(weights["bf"].dtype, "BF16");
    EXPECT_THAT(values_of<std::uint16_t>(weights["bf"]), ElementsAre(0x3fc0));
    EXPECT_THAT(weights["none"].shape, ElementsAre(0, 3));
    EXPECT_TRUE(weights["none"].values.empty());
    EXPECT_TRUE(weights["one"].shape.empty());
    EXPECT_THAT(values_of<float>(weights["one"]), ElementsAre(7));
    EXPECT_THAT(values_of<float>(weights["part"]), ElementsAre(3, 4, 5));
  }
}

// A tensor beside the table of weights is none of them.
TEST(TorchArchive, GivesTheWeightsOfACheckpointThatHoldsItsLoss) {
  const auto bytes = seed("good_checkpoint.pth");
  auto weights = weights_of(bytes);
  ASSERT_EQ(weights.size(), 1u);
  EXPECT_THAT(weights["w"].shape, ElementsAre(2, 2));
}

TEST(TorchArchive, NamesTheFormatBeforeArchives) {
  const std::string bytes = "\x80\x02\x8a\x0al\xfc\x9c\x46\xf9 j\xa8P\x19."s;
  const std::string problem =
      testing::problem_of([&] { parse_torch_archive(std::as_bytes(std::span(bytes)), "old.pth"); });
  EXPECT_THAT(problem, ::testing::HasSubstr("old.pth: is in the format of PyTorch before 1.6"));
}

TEST(TorchArchive, RefusesValuesThatDifferFromTheirChecksum) {
  auto bytes = seed("good_state.pth");
  const auto values = weights_of(bytes)["a.weight"].values;
  bytes[static_cast<std::size_t>(values.data() - bytes.data()) + 5] ^= std::byte{1};
  EXPECT_THROW(weights_of(bytes), InputError);
  EXPECT_EQ(parse_torch_archive(bytes, "seed", false).size(), 9u);
}

TEST(StoredZip, FindsItsEndBeforeAComment) {
  for (const char* name : {"good_state.pth", "good_small_zip.pth"}) {
    auto bytes = seed(name);
    const std::string comment = "PK\x05\x06 is how an end begins";
    bytes[bytes.size() - 2] = std::byte{static_cast<unsigned char>(comment.size())};
    const auto words = std::as_bytes(std::span(comment));
    bytes.insert(bytes.end(), words.begin(), words.end());
    const auto entries = parse_stored_zip(bytes, "zip");
    EXPECT_GE(entries.size(), 3u);
    for (const auto& [entry, content] : entries) EXPECT_TRUE(intact(content)) << entry;
  }
}

TEST(Pickle, NestsAndCirclesWithoutEnd) {
  EXPECT_EQ(unpickled("\x80\x02)" + std::string(1000000, '\x85') + ".").values.size(), 1000001u);
  const Pickle circle = unpickled("\x80\x02]q\0h\0a."s);
  ASSERT_EQ(circle.root->items.size(), 1u);
  EXPECT_EQ(circle.root->items[0], circle.root);
}

TEST(Pickle, IsLimitedInWhatItUnfoldsTo) {
  EXPECT_THROW(unpickled("\x80\x02" + std::string((1 << 20) + 1, ')') + "."), InputError);
  std::string again = "\x80\x02Nq\0"s;
  for (int i = 0; i < (4 << 20); ++i) again += "h\0"s;
  EXPECT_THROW(unpickled(again + "."), InputError);
}

TEST(Pickle, ReadsNumbersAsPythonWritesThem) {
  // pickle.dumps((0, 255, 65535, -1, 2**31, -2**63, True)) without its frame.
  const Pickle pickle = unpickled(
      "\x80\x02(K\0K\xffM\xff\xffJ\xff\xff\xff\xff\x8a\x05\0\0\0\x80\0"
      "\x8a\x08\0\0\0\0\0\0\0\x80\x88t."s);
  std::vector<std::int64_t> numbers;
  for (const PickleValue* item : pickle.root->items) numbers.push_back(item->number);
  EXPECT_THAT(numbers, ElementsAre(0, 255, 65535, -1, std::int64_t{1} << 31,
                                   std::numeric_limits<std::int64_t>::min(), 1));
}

}  // namespace
}  // namespace malus
