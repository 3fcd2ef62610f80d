// A thin layer over HDF5's C interface for the model file: named fields with unit and description,
// the same calls for writing and reading, so that one function describes the file in both
// directions. No HDF5 type leaves the two source files. HDF5's own error printing is silenced, and
// one lock serialises all calls (Debian's library is not thread-safe).
#pragma once

#include "malus/image/view.h"
#include "malus/noise/matrix.h"
#include "malus/noise/model_limits.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <memory>
#include <string>
#include <vector>

namespace malus::internal {

/// A data set's name in its group and the two attributes that every data set carries.
struct Field {
  std::string name;
  std::string unit;  ///< "1" for pure numbers, "" for text
  std::string description;
};

/// One HDF5 object, closed when the last copy goes.
class Hdf5Handle {
 public:
  Hdf5Handle() = default;
  Hdf5Handle(std::int64_t id, int (*close)(std::int64_t));
  std::int64_t id() const { return id_ ? *id_ : -1; }
  bool valid() const { return id() >= 0; }

 private:
  std::shared_ptr<std::int64_t> id_;
};

/// Silences HDF5 and holds the lock while it lives.
class Hdf5Session {
 public:
  Hdf5Session();
  ~Hdf5Session();
  Hdf5Session(const Hdf5Session&) = delete;
  Hdf5Session& operator=(const Hdf5Session&) = delete;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

/// Lengths and sizes beside kMostModelValues that a file may have.
inline constexpr std::size_t kMaxListItems = 1000;
inline constexpr std::size_t kMaxTexts = std::size_t{1} << 20;
inline constexpr std::size_t kMaxTextBytes = std::size_t{1} << 16;
inline constexpr std::size_t kMaxImagePixels = std::size_t{1} << 29;
inline constexpr std::size_t kMaxImages = 1000;

/// Writes into one group of a file. Empty vectors, matrices and images write nothing. Every
/// function throws Hdf5WriteError when HDF5 refuses (a full disk), and where a reader would refuse
/// what was written.
struct Hdf5WriteError {
  std::string field;
  std::string too_large;  ///< its shape; empty where HDF5 refuses
};

class Hdf5Writer {
 public:
  static constexpr bool kReading = false;
  /// Creates the file, replacing what is there.
  explicit Hdf5Writer(const std::filesystem::path& path);
  void version(const char* format, int number);
  void number(const Field& field, double value);
  void integer(const Field& field, int value);
  void text(const Field& field, const std::string& value);
  void texts(const Field& field, const std::vector<std::string>& values);
  void numbers(const Field& field, const std::vector<double>& values);
  void integers(const Field& field, const std::vector<std::int64_t>& values);
  void table(const Field& field, const std::vector<std::vector<double>>& rows);
  void matrix(const Field& field, const SquareMatrix& matrix);
  void image(const Field& field, const Image& image);
  void images(const Field& field, const std::vector<Image>& images);
  Hdf5Writer group(const std::string& name);
  /// One numbered group per item: name/000, name/001, ...
  template <class T, class Each>
  void list(const std::string& name, const std::vector<T>& items, Each&& each) {
    if (items.empty()) return;
    require_size(name, {items.size()}, kMaxListItems - 1);
    Hdf5Writer parent = group(name);
    for (std::size_t i = 0; i < items.size(); ++i) {
      Hdf5Writer child = parent.group(number_name(i));
      each(child, items[i]);
    }
  }
  /// Flushes everything to disk; to be called once, on the file's own writer.
  void close();

 private:
  Hdf5Writer(Hdf5Handle group, std::string where);
  static std::string number_name(std::size_t i);
  void data_set(const Field& field, std::int64_t type, const std::vector<std::size_t>& shape,
                const void* values, std::size_t item_bytes);
  void require_size(const std::string& name, const std::vector<std::size_t>& shape,
                    std::size_t max_values) const;
  Hdf5Handle file_, group_;
  std::string where_;
};

/// Reads from one group of a file. What the file lacks leaves the value as it is; what it holds in
/// another type, rank, size or unit than asked for throws InputError.
class Hdf5Reader {
 public:
  static constexpr bool kReading = true;
  explicit Hdf5Reader(const std::filesystem::path& path);
  /// The version attribute; throws InputError when there is none.
  int version() const;
  void number(const Field& field, double& value) const;
  void integer(const Field& field, int& value) const;
  void text(const Field& field, std::string& value) const;
  void texts(const Field& field, std::vector<std::string>& values) const;
  void numbers(const Field& field, std::vector<double>& values) const;
  void integers(const Field& field, std::vector<std::int64_t>& values) const;
  void table(const Field& field, std::vector<std::vector<double>>& rows) const;
  void matrix(const Field& field, SquareMatrix& matrix) const;
  void image(const Field& field, Image& image) const;
  void images(const Field& field, std::vector<Image>& images) const;
  Hdf5Reader group(const std::string& name) const;
  template <class T, class Each>
  void list(const std::string& name, std::vector<T>& items, Each&& each) const {
    if (!holds(name)) return;
    const Hdf5Reader parent = group(name);
    items.resize(parent.numbered_groups());
    for (std::size_t i = 0; i < items.size(); ++i) {
      const Hdf5Reader child = parent.group(number_name(i));
      each(child, items[i]);
    }
  }
  bool holds(const std::string& name) const;
  /// Without a remedy: of a damaged file.
  [[noreturn]] void fail(const std::string& name, const std::string& problem,
                         const std::string& remedy = "") const;

 private:
  Hdf5Reader(const Hdf5Reader& parent, Hdf5Handle group, std::string where);
  static std::string number_name(std::size_t i);
  std::size_t numbered_groups() const;
  std::string first_stranger(std::size_t entries) const;
  Hdf5Handle open(const Field& field, int type_class, std::size_t rank, std::size_t max_values,
                  std::vector<std::size_t>& shape) const;
  void require_filters(const Hdf5Handle& creation, const Field& field) const;
  void require_unit(const Hdf5Handle& data, const Field& field) const;
  [[noreturn]] void refuse_variable(const Field& field) const;
  void read(const Hdf5Handle& data, const Field& field, std::int64_t type, void* values) const;
  /// The part that the data spaces select.
  void read(const Hdf5Handle& data, const Field& field, std::int64_t type, void* values,
            const Hdf5Handle& in_memory, const Hdf5Handle& in_file) const;
  Hdf5Handle file_, group_;
  std::string path_, where_;
};

}  // namespace malus::internal
