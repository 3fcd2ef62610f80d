#include "malus/base/error.h"
#include "malus/base/text.h"
#include "malus/base/unreadable_file.h"
#include "malus/base/wording.h"
#include "malus/noise/builtin_models.h"
#include "malus/noise/internal/hdf5_archive.h"

#include <algorithm>
#include <array>
#include <climits>

#include <fmt/format.h>
#include <hdf5.h>

namespace malus::internal {
namespace {

// deflate cannot shrink by more than this, so a small file cannot ask for much memory.
constexpr std::size_t kLargestCompression = 1100;
constexpr std::size_t kFreeBytes = std::size_t{1} << 16;

std::string shape_text(const std::vector<std::size_t>& shape) {
  return shape.empty() ? "a single value" : fmt::format("{}", fmt::join(shape, " x "));
}

// Of an attribute of one text of fixed length, padded as other programs do, too.
std::string text_of(const Hdf5Handle& attribute, const Hdf5Handle& type) {
  const std::size_t size = H5Tget_size(type.id());
  if (size == 0 || size > kMaxTextBytes) return {};
  std::string text(size, '\0');
  if (H5Aread(attribute.id(), type.id(), text.data()) < 0) return {};
  text.resize(std::min(text.find('\0'), text.size()));
  text.resize(text.find_last_not_of(' ') + 1);
  return text;
}

// A file may hold anything for one.
std::string shown_unit(const std::string& unit) {
  constexpr std::size_t kLongest = 40;
  return unit.size() <= kLongest ? unit : unit.substr(0, kLongest) + "...";
}

}  // namespace

Hdf5Reader::Hdf5Reader(const std::filesystem::path& path) : path_(path.string()) {
  std::error_code error;
  const bool exists = std::filesystem::exists(path, error);
  if (error) throw unreadable_file(path);
  if (!exists)
    throw InputError(path_, "does not exist",
                     did_you_mean(path_, builtin_model_names()) + "check the path, or see " +
                         command("model list") + " for built-in models");
  if (std::filesystem::is_directory(path, error))
    throw InputError(path_, "is a folder", "name a noise model file");
  if (!can_be_opened(path)) throw unreadable_file(path);
  if (H5Fis_hdf5(path.c_str()) <= 0)
    throw InputError(path_, "is not an HDF5 file", "give a noise model that malus calibrate wrote");
  file_ = {H5Fopen(path.c_str(), H5F_ACC_RDONLY, H5P_DEFAULT), H5Fclose};
  if (!file_.valid()) fail("the file", "cannot be opened");
  group_ = {H5Gopen2(file_.id(), "/", H5P_DEFAULT), H5Gclose};
  if (!group_.valid()) fail("the root group", "cannot be opened");
}

Hdf5Reader::Hdf5Reader(const Hdf5Reader& parent, Hdf5Handle group, std::string where)
    : group_(std::move(group)), path_(parent.path_), where_(std::move(where)) {}

void Hdf5Reader::fail(const std::string& name, const std::string& problem,
                      const std::string& remedy) const {
  throw InputError(path_, fmt::format("{}{} {}", where_, name, problem),
                   remedy.empty() ? "the file is damaged or no malus noise model: calibrate again "
                                    "or take a copy"
                                  : remedy);
}

int Hdf5Reader::version() const {
  if (H5Aexists(group_.id(), "version") <= 0) fail("the version attribute", "is missing");
  const Hdf5Handle attribute(H5Aopen(group_.id(), "version", H5P_DEFAULT), H5Aclose);
  if (!attribute.valid()) fail("the version attribute", "cannot be read");
  const Hdf5Handle type(H5Aget_type(attribute.id()), H5Tclose);
  const Hdf5Handle space(H5Aget_space(attribute.id()), H5Sclose);
  int number = 0;
  if (H5Tget_class(type.id()) != H5T_INTEGER || H5Sget_simple_extent_npoints(space.id()) != 1 ||
      H5Aread(attribute.id(), H5T_NATIVE_INT, &number) < 0)
    fail("the version attribute", "is not one integer");
  return number;
}

std::string Hdf5Reader::number_name(std::size_t i) { return fmt::format("{:03}", i); }

// Only hard links: a soft or external one could lead anywhere.
bool Hdf5Reader::holds(const std::string& name) const {
  H5L_info_t info;
  const htri_t exists = H5Lexists(group_.id(), name.c_str(), H5P_DEFAULT);
  if (exists < 0) fail(name, "cannot be looked up");
  if (exists == 0) return false;
  if (H5Lget_info(group_.id(), name.c_str(), &info, H5P_DEFAULT) < 0 || info.type != H5L_TYPE_HARD)
    fail(name, "is not an ordinary link");
  return true;
}

Hdf5Reader Hdf5Reader::group(const std::string& name) const {
  if (!holds(name)) fail(name, "is missing");
  Hdf5Handle child(H5Gopen2(group_.id(), name.c_str(), H5P_DEFAULT), H5Gclose);
  if (!child.valid()) fail(name, "cannot be opened as a group");
  return {*this, std::move(child), where_ + name + "/"};
}

std::size_t Hdf5Reader::numbered_groups() const {
  std::size_t count = 0;
  while (count < kMaxListItems && holds(number_name(count))) ++count;
  if (count == kMaxListItems) fail("", fmt::format("holds {} entries or more", kMaxListItems));
  H5G_info_t info;
  if (H5Gget_info(group_.id(), &info) < 0) fail("", "cannot be listed");
  // What lies behind a gap would be passed over without a word. By name, the first that is no entry
  // stands where the next entry would, or before.
  if (info.nlinks > count)
    fail(first_stranger(count), "is no entry: they are numbered from 000 on");
  return count;
}

std::string Hdf5Reader::first_stranger(std::size_t entries) const {
  for (std::size_t i = 0; i <= entries; ++i) {
    std::array<char, 64> name{};
    H5Lget_name_by_idx(group_.id(), ".", H5_INDEX_NAME, H5_ITER_INC, i, name.data(), name.size(),
                       H5P_DEFAULT);
    if (name.data() != number_name(i)) return name.data();
  }
  return {};
}

void Hdf5Reader::require_filters(const Hdf5Handle& creation, const Field& field) const {
  constexpr H5Z_filter_t kLzf = 32000;  // as h5py registered it
  for (int i = 0, n = H5Pget_nfilters(creation.id()); i < n; ++i) {
    unsigned flags = 0, settings = 0;
    std::size_t count = 0;
    const H5Z_filter_t filter = H5Pget_filter2(creation.id(), static_cast<unsigned>(i), &flags,
                                               &count, nullptr, 0, nullptr, &settings);
    if (filter == H5Z_FILTER_DEFLATE || filter == H5Z_FILTER_SHUFFLE ||
        filter == H5Z_FILTER_FLETCHER32)
      continue;
    fail(field.name,
         fmt::format("is compressed by a filter that is not read ({})",
                     filter == kLzf ? "lzf" : fmt::format("number {}", filter)),
         "store it with gzip or without compression");
  }
}

void Hdf5Reader::refuse_variable(const Field& field) const {
  fail(field.name, "is text of variable length",
       "store it as text of fixed length (h5py: numpy.bytes_)");
}

// A file without the attribute says nothing else than what is expected. Text of variable length is
// not read, as of older files: it lies in a heap that has no checksum, and libhdf5 crashes on one
// that is damaged.
void Hdf5Reader::require_unit(const Hdf5Handle& data, const Field& field) const {
  if (field.unit.empty() || H5Aexists(data.id(), "unit") <= 0) return;
  const Hdf5Handle attribute(H5Aopen(data.id(), "unit", H5P_DEFAULT), H5Aclose);
  const Hdf5Handle type(attribute.valid() ? H5Aget_type(attribute.id()) : -1, H5Tclose);
  const Hdf5Handle space(attribute.valid() ? H5Aget_space(attribute.id()) : -1, H5Sclose);
  if (!type.valid() || !space.valid()) fail(field.name, "has an attribute unit that is unreadable");
  if (H5Tget_class(type.id()) != H5T_STRING || H5Sget_simple_extent_npoints(space.id()) != 1)
    fail(field.name, "has an attribute unit that is not one text");
  if (H5Tis_variable_str(type.id()) != 0) return;
  const std::string unit = text_of(attribute, type);
  if (unit != field.unit)
    fail(field.name,
         fmt::format("has the attribute unit \"{}\", not \"{}\"", shown_unit(unit), field.unit),
         fmt::format("store its values in \"{}\" and name that", field.unit));
}

Hdf5Handle Hdf5Reader::open(const Field& field, int type_class, std::size_t rank,
                            std::size_t max_values, std::vector<std::size_t>& shape) const {
  if (!holds(field.name)) return {};
  Hdf5Handle data(H5Dopen2(group_.id(), field.name.c_str(), H5P_DEFAULT), H5Dclose);
  if (!data.valid()) fail(field.name, "cannot be opened as a data set");
  const Hdf5Handle type(H5Dget_type(data.id()), H5Tclose);
  const Hdf5Handle space(H5Dget_space(data.id()), H5Sclose);
  const Hdf5Handle creation(H5Dget_create_plist(data.id()), H5Pclose);
  if (!type.valid() || !space.valid() || !creation.valid()) fail(field.name, "cannot be read");
  if (H5Tget_class(type.id()) != type_class) fail(field.name, "has the wrong type");
  if (H5Sget_simple_extent_type(space.id()) == H5S_NULL) fail(field.name, "is empty");
  const int found = H5Sget_simple_extent_ndims(space.id());
  if (found != static_cast<int>(rank))
    fail(field.name, fmt::format("has {} dimensions, not {}", found, rank));
  std::vector<hsize_t> dims(rank);
  if (rank > 0 && H5Sget_simple_extent_dims(space.id(), dims.data(), nullptr) < 0)
    fail(field.name, "has no size");
  shape.assign(dims.begin(), dims.end());
  std::size_t values = 1;
  for (std::size_t n : shape) {
    if (n == 0 || n > max_values / values)
      fail(field.name, fmt::format("has an impossible size: {}", shape_text(shape)));
    values *= n;
  }
  if (H5Pget_external_count(creation.id()) != 0 || H5Pget_layout(creation.id()) == H5D_VIRTUAL)
    fail(field.name, "is stored in a way that a noise model does not use");
  require_filters(creation, field);
  const std::size_t item = H5Tget_size(type.id());
  const std::size_t stored = H5Dget_storage_size(data.id());
  if (item == 0 || item > kMaxTextBytes ||
      values > (stored * kLargestCompression + kFreeBytes) / item)
    fail(field.name, fmt::format("claims {} in {} stored bytes", shape_text(shape), stored));
  require_unit(data, field);
  return data;
}

void Hdf5Reader::read(const Hdf5Handle& data, const Field& field, std::int64_t type,
                      void* values) const {
  const Hdf5Handle all(H5Dget_space(data.id()), H5Sclose);
  read(data, field, type, values, all, all);
}

void Hdf5Reader::read(const Hdf5Handle& data, const Field& field, std::int64_t type, void* values,
                      const Hdf5Handle& in_memory, const Hdf5Handle& in_file) const {
  if (H5Dread(data.id(), type, in_memory.id(), in_file.id(), H5P_DEFAULT, values) < 0)
    fail(field.name, "cannot be read: its checksum or its storage is wrong");
}

void Hdf5Reader::number(const Field& field, double& value) const {
  std::vector<std::size_t> shape;
  if (const Hdf5Handle data = open(field, H5T_FLOAT, 0, 1, shape); data.valid())
    read(data, field, H5T_NATIVE_DOUBLE, &value);
}

void Hdf5Reader::integer(const Field& field, int& value) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_INTEGER, 0, 1, shape);
  if (!data.valid()) return;
  std::int64_t wide = 0;
  read(data, field, H5T_NATIVE_INT64, &wide);
  if (wide < INT_MIN || wide > INT_MAX) fail(field.name, fmt::format("is {}", wide));
  value = static_cast<int>(wide);
}

void Hdf5Reader::text(const Field& field, std::string& value) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_STRING, 0, 1, shape);
  if (!data.valid()) return;
  const Hdf5Handle type(H5Dget_type(data.id()), H5Tclose);
  if (H5Tis_variable_str(type.id()) != 0) refuse_variable(field);
  value.assign(H5Tget_size(type.id()), '\0');
  read(data, field, type.id(), value.data());
  value.resize(std::min(value.find('\0'), value.size()));
}

void Hdf5Reader::texts(const Field& field, std::vector<std::string>& values) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_STRING, 1, kMaxTexts, shape);
  if (!data.valid()) return;
  const Hdf5Handle type(H5Dget_type(data.id()), H5Tclose);
  if (H5Tis_variable_str(type.id()) != 0) refuse_variable(field);
  const std::size_t width = H5Tget_size(type.id());
  std::string packed(width * shape[0], '\0');
  read(data, field, type.id(), packed.data());
  values.clear();
  for (std::size_t i = 0; i < shape[0]; ++i) {
    const std::string item = packed.substr(i * width, width);
    values.push_back(item.substr(0, item.find('\0')));
  }
}

void Hdf5Reader::numbers(const Field& field, std::vector<double>& values) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_FLOAT, 1, kMostModelValues, shape);
  if (!data.valid()) return;
  values.resize(shape[0]);
  read(data, field, H5T_NATIVE_DOUBLE, values.data());
}

void Hdf5Reader::integers(const Field& field, std::vector<std::int64_t>& values) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_INTEGER, 1, kMostModelValues, shape);
  if (!data.valid()) return;
  values.resize(shape[0]);
  read(data, field, H5T_NATIVE_INT64, values.data());
}

void Hdf5Reader::table(const Field& field, std::vector<std::vector<double>>& rows) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_FLOAT, 2, kMostModelValues, shape);
  if (!data.valid()) return;
  std::vector<double> flat(shape[0] * shape[1]);
  read(data, field, H5T_NATIVE_DOUBLE, flat.data());
  rows.clear();
  for (auto row = flat.begin(); row != flat.end(); row += static_cast<std::ptrdiff_t>(shape[1]))
    rows.emplace_back(row, row + static_cast<std::ptrdiff_t>(shape[1]));
}

void Hdf5Reader::matrix(const Field& field, SquareMatrix& matrix) const {
  std::vector<std::vector<double>> rows;
  table(field, rows);
  if (rows.empty()) return;
  if (rows.size() != rows[0].size() || rows.size() > kMaxListItems)
    fail(field.name, fmt::format("is {} x {}, not square", rows.size(), rows[0].size()));
  matrix = SquareMatrix(static_cast<int>(rows.size()));
  auto to = matrix.values.begin();
  for (const auto& row : rows) to = std::copy(row.begin(), row.end(), to);
}

void Hdf5Reader::image(const Field& field, Image& image) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_FLOAT, 2, kMaxImagePixels, shape);
  if (!data.valid()) return;
  image = Image(static_cast<int>(shape[0]), static_cast<int>(shape[1]));
  read(data, field, H5T_NATIVE_FLOAT, image.values().data());
}

void Hdf5Reader::images(const Field& field, std::vector<Image>& images) const {
  std::vector<std::size_t> shape;
  const Hdf5Handle data = open(field, H5T_FLOAT, 3, kMaxImages * kMaxImagePixels, shape);
  if (!data.valid()) return;
  if (shape[0] > kMaxImages || shape[1] * shape[2] > kMaxImagePixels)
    fail(field.name, fmt::format("has an impossible size: {}", shape_text(shape)));
  const std::vector<hsize_t> one = {1, shape[1], shape[2]};
  const Hdf5Handle file(H5Dget_space(data.id()), H5Sclose);
  const Hdf5Handle memory(H5Screate_simple(3, one.data(), nullptr), H5Sclose);
  images.clear();
  for (std::size_t i = 0; i < shape[0]; ++i) {
    images.emplace_back(static_cast<int>(shape[1]), static_cast<int>(shape[2]));
    const std::vector<hsize_t> first = {i, 0, 0};
    if (H5Sselect_hyperslab(file.id(), H5S_SELECT_SET, first.data(), nullptr, one.data(), nullptr) <
        0)
      fail(field.name, "cannot be read");
    read(data, field, H5T_NATIVE_FLOAT, images.back().values().data(), memory, file);
  }
}

}  // namespace malus::internal
