// Planes and bounded views. Views are checked when they are made; element access is checked where
// MALUS_CHECK_ACCESS is set, as the presets dev, asan-ubsan, tsan and fuzz do. A program that links
// malus leaves it as the library was built.
#pragma once

#include "malus/base/error.h"
#include "malus/base/large_pages.h"

#include <cstddef>
#include <span>
#include <type_traits>
#include <vector>

namespace malus {

/// A rows x cols window into memory it does not own. Elements of a row are contiguous; rows are
/// `stride` elements apart.
template <class T>
class View {
 public:
  View() = default;
  /// Contract: rows, cols >= 0, stride >= cols, and memory covers the last row.
  View(std::span<T> memory, int rows, int cols, std::ptrdiff_t stride)
      : data_(memory.data()), rows_(rows), cols_(cols), stride_(stride) {
    MALUS_REQUIRE(rows >= 0 && cols >= 0 && stride >= cols);
    MALUS_REQUIRE(rows == 0 || cols == 0 ||
                  static_cast<std::ptrdiff_t>(memory.size()) >= (rows - 1) * stride + cols);
  }
  /// A writable view serves where a read-only one is asked for.
  template <class U>
  requires(std::is_same_v<const U, T> && !std::is_same_v<U, T>)
      View(const View<U>& other)  // NOLINT: implicit by design
      : data_(other.data()), rows_(other.rows()), cols_(other.cols()), stride_(other.stride()) {}

  int rows() const { return rows_; }
  int cols() const { return cols_; }
  std::ptrdiff_t stride() const { return stride_; }
  T* data() const { return data_; }
  bool empty() const { return rows_ == 0 || cols_ == 0; }
  bool contiguous() const { return stride_ == cols_; }

  T* row(int r) const {
#ifdef MALUS_CHECK_ACCESS
    MALUS_REQUIRE(r >= 0 && r < rows_);
#endif
    return data_ + r * stride_;
  }
  std::span<T> row_span(int r) const { return {row(r), static_cast<std::size_t>(cols_)}; }
  T& operator()(int r, int c) const {
#ifdef MALUS_CHECK_ACCESS
    MALUS_REQUIRE(c >= 0 && c < cols_);
#endif
    return row(r)[c];
  }
  /// A window; contract: it lies inside.
  View window(int row0, int col0, int rows, int cols) const {
    MALUS_REQUIRE(row0 >= 0 && col0 >= 0 && rows >= 0 && cols >= 0 && rows <= rows_ - row0 &&
                  cols <= cols_ - col0);
    View w;
    w.data_ = data_ + row0 * stride_ + col0;
    w.rows_ = rows;
    w.cols_ = cols;
    w.stride_ = stride_;
    return w;
  }

 private:
  T* data_ = nullptr;
  int rows_ = 0, cols_ = 0;
  std::ptrdiff_t stride_ = 0;
};

/// An owned rows x cols plane, row-major, contiguous, zero-initialised.
template <class T>
class Plane {
 public:
  Plane() = default;
  Plane(int rows, int cols, T value = T{}) : rows_(rows), cols_(cols) {
    MALUS_REQUIRE(rows >= 0 && cols >= 0);
    const auto size = static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
    values_.reserve(size);
    prepare_pages(values_.data(), size * sizeof(T));
    values_.assign(size, value);
  }
  int rows() const { return rows_; }
  int cols() const { return cols_; }
  std::size_t size() const { return values_.size(); }
  bool empty() const { return values_.empty(); }
  View<T> view() { return {std::span<T>(values_), rows_, cols_, cols_}; }
  View<const T> view() const { return {std::span<const T>(values_), rows_, cols_, cols_}; }
  operator View<T>() { return view(); }              // NOLINT: implicit by design
  operator View<const T>() const { return view(); }  // NOLINT: implicit by design
  T* row(int r) { return view().row(r); }
  const T* row(int r) const { return view().row(r); }
  T& operator()(int r, int c) { return view()(r, c); }
  const T& operator()(int r, int c) const { return view()(r, c); }
  std::vector<T>& values() { return values_; }
  const std::vector<T>& values() const { return values_; }
  bool operator==(const Plane&) const = default;

 private:
  int rows_ = 0, cols_ = 0;
  std::vector<T> values_;
};

using Image = Plane<float>;

/// Equal-sized planes: [channel, row, column]. A packed colour-polarization image has 16 of a
/// quarter of the width.
class Planes {
 public:
  Planes() = default;
  Planes(int channels, int rows, int cols) {
    MALUS_REQUIRE(channels >= 0);
    for (int k = 0; k < channels; ++k) planes_.emplace_back(rows, cols);
  }
  int channels() const { return static_cast<int>(planes_.size()); }
  int rows() const { return planes_.empty() ? 0 : planes_[0].rows(); }
  int cols() const { return planes_.empty() ? 0 : planes_[0].cols(); }
  Image& operator[](int channel) { return planes_.at(static_cast<std::size_t>(channel)); }
  const Image& operator[](int channel) const {
    return planes_.at(static_cast<std::size_t>(channel));
  }
  auto begin() { return planes_.begin(); }
  auto end() { return planes_.end(); }
  auto begin() const { return planes_.begin(); }
  auto end() const { return planes_.end(); }

 private:
  std::vector<Image> planes_;
};

}  // namespace malus
