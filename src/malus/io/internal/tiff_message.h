// libtiff's files, and what it complains of. It calls back with a message, and prints unless told
// otherwise.
#pragma once

#include <cstdarg>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <string>

#include <tiffio.h>

namespace malus::internal {

struct CloseTiff {
  void operator()(TIFF* tiff) const { TIFFClose(tiff); }
};
using OpenTiff = std::unique_ptr<TIFF, CloseTiff>;

/// Has to outlive the files that were opened with its options.
class TiffMessage {
 public:
  explicit TiffMessage(std::filesystem::path path) : path_(std::move(path)) {
    TIFFOpenOptionsSetErrorHandlerExtR(options_.get(), keep, this);
    TIFFOpenOptionsSetWarningHandlerExtR(options_.get(), pass_over, nullptr);
  }
  TiffMessage(const TiffMessage&) = delete;
  TiffMessage& operator=(const TiffMessage&) = delete;

  TIFFOpenOptions* options() const { return options_.get(); }
  const std::filesystem::path& path() const { return path_; }
  /// The first error, which is the cause; empty where there was none.
  const std::string& text() const { return text_; }

 private:
  struct FreeOptions {
    void operator()(TIFFOpenOptions* options) const { TIFFOpenOptionsFree(options); }
  };

  static int keep(TIFF*, void* self, const char*, const char* format, std::va_list arguments) {
    char text[512];
    std::vsnprintf(text, sizeof text, format, arguments);
    auto& message = static_cast<TiffMessage*>(self)->text_;
    if (message.empty()) message = text;
    return 1;  // it is not printed
  }
  static int pass_over(TIFF*, void*, const char*, const char*, std::va_list) { return 1; }

  std::filesystem::path path_;
  std::string text_;
  std::unique_ptr<TIFFOpenOptions, FreeOptions> options_{TIFFOpenOptionsAlloc()};
};

}  // namespace malus::internal
