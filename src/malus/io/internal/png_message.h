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

inline void require_state(png_structp png, png_infop info) {
  if (png == nullptr || info == nullptr) throw std::bad_alloc();
}

struct PngReader {
  PngMessage message;
  png_structp png = png_create_read_struct(PNG_LIBPNG_VER_STRING, &message, PngMessage::keep,
                                           PngMessage::pass_over);
  png_infop info = png_create_info_struct(png);

  PngReader() { require_state(png, info); }
  PngReader(const PngReader&) = delete;
  PngReader& operator=(const PngReader&) = delete;
  ~PngReader() { png_destroy_read_struct(&png, &info, nullptr); }
};

struct PngWriter {
  PngMessage message;
  png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, &message, PngMessage::keep,
                                            PngMessage::pass_over);
  png_infop info = png_create_info_struct(png);

  PngWriter() { require_state(png, info); }
  PngWriter(const PngWriter&) = delete;
  PngWriter& operator=(const PngWriter&) = delete;
  ~PngWriter() { png_destroy_write_struct(&png, &info); }
};

}  // namespace malus::internal
