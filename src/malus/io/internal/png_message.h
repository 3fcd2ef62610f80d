// libpng's state, and what it complains of. It leaves by longjmp: a function that calls setjmp
// holds nothing that has to be destroyed.
#pragma once

#include <csetjmp>
#include <new>
#include <string>

#include <png.h>

namespace malus::internal {

/// Its first error, which ends the work; warnings are not meant.
struct PngMessage {
  std::string text;

  [[noreturn]] static void keep(png_structp png, png_const_charp text) {
    static_cast<PngMessage*>(png_get_error_ptr(png))->text = text;
    png_longjmp(png, 1);
  }
  static void pass_over(png_structp, png_const_charp) {}
};

template <auto kCreate, auto kDestroy>
struct PngState {
  PngMessage message;
  png_structp png =
      kCreate(PNG_LIBPNG_VER_STRING, &message, PngMessage::keep, PngMessage::pass_over);
  png_infop info = png_create_info_struct(png);

  PngState() {
    if (png == nullptr || info == nullptr) throw std::bad_alloc();
  }
  PngState(const PngState&) = delete;
  PngState& operator=(const PngState&) = delete;
  ~PngState() { kDestroy(&png, &info); }
};

inline void destroy_png_reader(png_structpp png, png_infopp info) {
  png_destroy_read_struct(png, info, nullptr);
}

using PngReader = PngState<png_create_read_struct, destroy_png_reader>;
using PngWriter = PngState<png_create_write_struct, png_destroy_write_struct>;

}  // namespace malus::internal
