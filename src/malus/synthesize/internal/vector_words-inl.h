// The random words of a mosaic row, by the vector unit: the map of formation.h's pixel_words.
// Included once per instruction set, as vector_arithmetic-inl.h.
#if defined(MALUS_VECTOR_WORDS_INL_H_) == defined(HWY_TARGET_TOGGLE)
#ifdef MALUS_VECTOR_WORDS_INL_H_
#undef MALUS_VECTOR_WORDS_INL_H_
#else
#define MALUS_VECTOR_WORDS_INL_H_
#endif

#include "malus/synthesize/internal/vector_arithmetic-inl.h"

#include <algorithm>
#include <cstddef>

HWY_BEFORE_NAMESPACE();
namespace malus::internal::HWY_NAMESPACE {

// In column order.
struct GroupWords {
  HWY_ALIGN std::uint32_t shot[kGroupColumns], read[kGroupColumns];
};

#if HWY_TARGET != HWY_SCALAR

class RowWords {
 public:
  HWY_INLINE RowWords(std::uint64_t seed, std::uint32_t frame, int row) : frame_(frame), row_(row) {
    auto first = static_cast<std::uint32_t>(seed), second = static_cast<std::uint32_t>(seed >> 32);
    for (int round = 0; round < kRounds; ++round) {
      hn::Store(hn::Set(Pairs(), first), Pairs(), key0_[round]);
      hn::Store(hn::Set(Pairs(), second), Pairs(), key1_[round]);
      first += 0x9E3779B9u;
      second += 0xBB67AE85u;
    }
  }

  /// The words of one group; quick where groups are asked for in rising order.
  HWY_INLINE const GroupWords& of(int group) {
    if (group < first_group_ || group >= first_group_ + kGroupsAtOnce) {
      first_group_ = group;
      for (int block = 0; block < 16 * kGroupsAtOnce; block += kBlocksAtOnce) fill(block);
    }
    return groups_[group - first_group_];
  }

 private:
  using PairVec = hn::Vec<Pairs>;
  static constexpr int kRounds = 10, kGroupsAtOnce = 2;
  // A round waits for its multiplications: four vectors of blocks side by side keep the unit busy.
  static constexpr int kVectors = 4, kBlocksAtOnce = kVectors * kLanes / 2;

  // Blocks first .. first + kBlocksAtOnce - 1 of the groups held. 64-bit lanes: what lies above a
  // word is never read. Vectors 2 k and 2 k + 1 hold even and odd blocks.
  HWY_INLINE void fill(int first) {
    const Pairs d;
    const Words w;
    const auto multiplier0 = hn::BitCast(w, hn::Set(d, 0xD2511F53u));
    const auto multiplier1 = hn::BitCast(w, hn::Set(d, 0xCD9E8D57u));
    PairVec word0[kVectors], word1[kVectors], word2[kVectors], word3[kVectors];
    for (int i = 0; i < kVectors; ++i) {
      const auto start =
          static_cast<std::uint32_t>(16 * first_group_ + first + i / 2 * kLanes + i % 2);
      word0[i] = hn::Add(hn::Set(d, start), hn::ShiftLeft<1>(hn::Iota(d, 0)));
      word1[i] = hn::Set(d, static_cast<std::uint32_t>(row_));
      word2[i] = hn::Set(d, frame_);
      word3[i] = hn::Set(d, static_cast<std::uint32_t>(Draw::kPixel) << 24);
    }
    for (int round = 0; round < kRounds; ++round) {
      const auto key0 = hn::Load(d, key0_[round]), key1 = hn::Load(d, key1_[round]);
      for (int i = 0; i < kVectors; ++i) {
        const auto product0 = hn::MulEven(hn::BitCast(w, word0[i]), multiplier0);
        const auto product1 = hn::MulEven(hn::BitCast(w, word2[i]), multiplier1);
        word0[i] = hn::Xor3(hn::ShiftRight<32>(product1), word1[i], key0);
        word2[i] = hn::Xor3(hn::ShiftRight<32>(product0), word3[i], key1);
        word1[i] = product1;
        word3[i] = product0;
      }
    }
    for (int i = 0; i < kVectors; i += 2) {
      const int block = first + i / 2 * kLanes;
      GroupWords& group = groups_[block / 16];
      const int place = block % 16;
      store(word0[i], word0[i + 1], group.shot + place);
      store(word1[i], word1[i + 1], group.read + place);
      store(word2[i], word2[i + 1], group.shot + 16 + place);
      store(word3[i], word3[i + 1], group.read + 16 + place);
    }
  }
  static HWY_INLINE void store(PairVec even, PairVec odd, std::uint32_t* to) {
    const Words w;
    hn::Store(hn::OddEven(hn::BitCast(w, hn::ShiftLeft<32>(odd)), hn::BitCast(w, even)), w, to);
  }

  HWY_ALIGN std::uint64_t key0_[kRounds][hn::MaxLanes(Pairs())];
  HWY_ALIGN std::uint64_t key1_[kRounds][hn::MaxLanes(Pairs())];
  GroupWords groups_[kGroupsAtOnce];
  std::uint32_t frame_;
  int row_, first_group_ = -kGroupsAtOnce;
};

#else

class RowWords {
 public:
  RowWords(std::uint64_t seed, std::uint32_t frame, int row)
      : seed_(seed), frame_(frame), row_(row) {}
  const GroupWords& of(int group) {
    for (int place = 0; place < kGroupColumns; ++place) {
      const PixelWords words = pixel_words(seed_, frame_, row_, group * kGroupColumns + place);
      words_.shot[place] = words.shot;
      words_.read[place] = words.read;
    }
    return words_;
  }

 private:
  std::uint64_t seed_;
  std::uint32_t frame_;
  int row_;
  GroupWords words_;
};

#endif

// One after the other, the groups of columns that a kernel's row lies in.
class ColumnGroup {
 public:
  template <class Job>
  HWY_INLINE explicit ColumnGroup(const Job& job)
      : col0_(job.col0),
        end_(job.col0 + job.cols),
        period_(job.lanes.period),
        number_(job.col0 / kGroupColumns),
        phase_(number_ * kGroupColumns % job.lanes.period) {}

  HWY_INLINE bool is_in_row() const { return start() < end_; }
  HWY_INLINE void advance() {
    ++number_;
    phase_ += kGroupColumns;
    if (phase_ == period_) phase_ = 0;
  }
  HWY_INLINE int number() const { return number_; }
  HWY_INLINE int phase() const { return phase_; }  ///< of its first column in the lanes' period
  /// Of its columns the row has [from, to): at the ends not all.
  HWY_INLINE bool is_whole() const { return start() >= col0_ && start() + kGroupColumns <= end_; }
  HWY_INLINE int from() const { return std::max(col0_ - start(), 0); }
  HWY_INLINE int to() const { return std::min(end_ - start(), kGroupColumns); }
  /// Where the job's arrays hold its first column, or would: they begin with the row.
  HWY_INLINE std::ptrdiff_t at() const { return start() - col0_; }

 private:
  HWY_INLINE int start() const { return number_ * kGroupColumns; }
  int col0_, end_, period_, number_, phase_;
};

}  // namespace malus::internal::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();
#endif  // per target
