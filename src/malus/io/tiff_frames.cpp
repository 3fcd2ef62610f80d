#include "malus/io/internal/tiff_frames.h"

#include "malus/base/error.h"
#include "malus/io/frame_stack.h"
#include "malus/io/internal/tiff_file.h"

#include <algorithm>
#include <array>
#include <cstdlib>
#include <ctime>
#include <deque>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <sys/stat.h>

namespace malus::internal {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kWhiteIsZero = 0, kBlackIsZero = 1;

// What all frames of a stack share.
struct PageKind {
  std::uint64_t cols, rows, samples, bits, sample_format, photometric;
  bool operator==(const PageKind&) const = default;

  std::string text() const {
    const char* const type = sample_format == 3   ? "float"
                             : sample_format == 2 ? "int"
                             : sample_format == 1 ? "uint"
                                                  : "unknown";
    const std::string meaning = photometric == kWhiteIsZero ? ", 0 is white"
                                : photometric == kBlackIsZero
                                    ? ""
                                    : fmt::format(" of photometric interpretation {}", photometric);
    return fmt::format("{}x{} pixels of {}{}{}{}", cols, rows, type, bits,
                       samples == 1 ? "" : fmt::format(" in {} channels", samples), meaning);
  }
};

PageKind kind_of(const TiffTags& tags) {
  return {tags.one(kCols, 0), tags.one(kRows, 0),         tags.one(kSamples, 1),
          tags.one(kBits, 1), tags.one(kSampleFormat, 1), tags.one(kPhotometric, kBlackIsZero)};
}

bool is_frame_page(const TiffTags& tags) {
  constexpr std::uint64_t kReduced = 1, kMask = 4, kOldReduced = 2;
  return (tags.one(kSubfile, 0) & (kReduced | kMask)) == 0 &&
         tags.one(kOldSubfile, 0) != kOldReduced;
}

[[noreturn]] void refuse_pages(const TiffFile& file, std::string_view problem,
                               std::string_view remedy) {
  throw InputError(file.path.string(), problem, remedy);
}

// Beyond 4 GB ImageJ writes the pixels of all images one after the other, and one directory.
long images_of_imagej(const std::string& description) {
  constexpr std::string_view kImages = "\nimages=";
  const std::size_t at = description.find(kImages);
  if (!description.starts_with("ImageJ=") || at == description.npos) return 0;
  return std::strtol(description.c_str() + at + kImages.size(), nullptr, 10);
}

// As tifffile does when it is asked to (truncate=True). Whoever cuts one frame out of a stack may
// leave its description as it was, without that word.
long images_of_tifffile(const std::string& description, const PageKind& page) {
  if (!description.starts_with('{')) return 0;
  const auto told = nlohmann::json::parse(description, nullptr, false);
  if (!told.is_object() || told.value("truncated", nlohmann::json()) != true) return 0;
  double values = 1;
  for (const auto& extent : told.value("shape", nlohmann::json::array()))
    values *= extent.is_number() ? extent.get<double>() : 1.0;
  const double of_page = static_cast<double>(page.cols) * static_cast<double>(page.rows) *
                         static_cast<double>(page.samples);
  // A shape with 0 beside infinity is no number.
  return values > of_page ? static_cast<long>(std::min(values / of_page, 1e9)) : 1;
}

// One page whose description tells of more: the others would be lost without a word.
void refuse_hidden_images(const TiffFile& file, const TiffTags& tags) {
  constexpr std::uint64_t kBeginning = 4096;
  const std::string text = tags.text(kDescription, kBeginning);
  const long of_imagej = images_of_imagej(text),
             of_tifffile = images_of_tifffile(text, kind_of(tags));
  if (of_imagej > 1 || of_tifffile > 1)
    refuse_pages(
        file,
        fmt::format("it holds {} images of {}, but one page", std::max(of_imagej, of_tifffile),
                    of_imagej > 1 ? "ImageJ" : "tifffile"),
        "save the frames as several pages, as single files or as a .npy array");
}

// The frames of one file, page by page.
class PageWalk {
 public:
  explicit PageWalk(const TiffFile& file) : file_(file) {}

  std::vector<std::uint64_t> frames() {
    std::uint64_t at = file_.first_directory;
    do at = take_page(at);
    while (at != 0);
    if (frames_.empty())
      refuse_pages(file_, fmt::format("none of its {} pages is a frame of full size", seen_.size()),
                   "save the frames without their thumbnails");
    return std::move(frames_);
  }

 private:
  // Returns where the next one is, 0 after the last.
  std::uint64_t take_page(std::uint64_t at) {
    if (!seen_.insert(at).second)
      refuse_pages(file_, fmt::format("page {} leads back to an earlier page", seen_.size()),
                   "the file is damaged: copy or record it again");
    const std::size_t page = seen_.size();
    if (page > static_cast<std::size_t>(kMostStackFrames))
      refuse_pages(file_, fmt::format("it has more than {} pages", kMostStackFrames),
                   "save it in several files");
    const TiffTags tags(file_, at, page == 1 ? "directory" : fmt::format("page {}", page));
    const bool alone = page == 1 && tags.next() == 0;
    if (alone) refuse_hidden_images(file_, tags);
    if (alone || is_frame_page(tags)) take_frame(at, kind_of(tags));
    return tags.next();
  }

  void take_frame(std::uint64_t at, const PageKind& kind) {
    if (!first_) first_ = kind;
    if (!(kind == *first_))
      throw InputError(
          frame_name(file_.path, static_cast<int>(frames_.size())).string(),
          fmt::format("has {}, the frame [0] of its file {}", kind.text(), first_->text()),
          "frames of one stack have one size and type: save others in files of their own");
    frames_.push_back(at);
  }

  const TiffFile& file_;
  std::unordered_set<std::uint64_t> seen_;
  std::vector<std::uint64_t> frames_;
  std::optional<PageKind> first_;
};

// Stacks whose pages were walked already: frame by frame from the first page on, N frames would
// take N² / 2 pages.
class WalkedStacks {
 public:
  TiffFramePlaces find(const struct stat& file) {
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock) return nullptr;  // the file itself tells; a forked process may wait for ever
    const auto found = std::find_if(stacks_.begin(), stacks_.end(),
                                    [&](const Stack& stack) { return is_same(stack.file, file); });
    return found == stacks_.end() ? nullptr : found->places;
  }

  void keep(const struct stat& file, const TiffFramePlaces& places) {
    constexpr std::size_t kMostStacks = 64;
    const std::unique_lock lock(mutex_, std::try_to_lock);
    if (!lock || places->size() < 2 || !is_settled(file)) return;
    stacks_.push_front({file, places});
    if (stacks_.size() > kMostStacks) stacks_.pop_back();
  }

 private:
  struct Stack {
    struct stat file;
    TiffFramePlaces places;
  };
  // A file that was written just now may be written again within one tick of the clock.
  static bool is_settled(const struct stat& file) {
    constexpr std::time_t kSettled_s = 2;
    return std::time(nullptr) - file.st_mtim.tv_sec > kSettled_s &&
           std::time(nullptr) - file.st_ctim.tv_sec > kSettled_s;
  }
  static bool is_same(const struct stat& a, const struct stat& b) {
    const auto times = [](const struct stat& file) {
      return std::array{file.st_mtim.tv_sec, file.st_mtim.tv_nsec, file.st_ctim.tv_sec,
                        file.st_ctim.tv_nsec};
    };
    return a.st_dev == b.st_dev && a.st_ino == b.st_ino && a.st_size == b.st_size &&
           times(a) == times(b);
  }

  std::mutex mutex_;
  std::deque<Stack> stacks_;
};

WalkedStacks& walked_stacks() {
  static WalkedStacks stacks;
  return stacks;
}

}  // namespace

TiffFramePlaces tiff_frames(const fs::path& path) {
  const std::uintmax_t file_bytes = require_file(path);
  struct stat file {};
  const bool known = ::stat(path.c_str(), &file) == 0;
  if (known)
    if (TiffFramePlaces places = walked_stacks().find(file)) return places;
  const TiffFile tiff = tiff_file(path, file_bytes);
  const auto places = std::make_shared<const std::vector<std::uint64_t>>(PageWalk(tiff).frames());
  if (known) walked_stacks().keep(file, places);
  return places;
}

}  // namespace malus::internal
