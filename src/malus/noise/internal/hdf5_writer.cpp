#include "malus/base/error.h"
#include "malus/noise/internal/hdf5_archive.h"

#include <algorithm>
#include <functional>
#include <mutex>
#include <numeric>
#include <type_traits>

#include <fmt/format.h>
#include <hdf5.h>

namespace malus::internal {
namespace {

static_assert(std::is_same_v<std::int64_t, hid_t>, "handles are kept as 64-bit integers");

// Metadata of this version carries checksums, and the data sets of compact layout are part of it:
// damage is noticed by the library itself.
constexpr H5F_libver_t kFileVersion = H5F_LIBVER_V110;
constexpr std::size_t kCompactBytes = 8192;
constexpr unsigned kDeflateLevel = 4;
constexpr std::size_t kChunkSide = 512;

std::recursive_mutex& hdf5_mutex() {
  static std::recursive_mutex mutex;
  return mutex;
}

Hdf5Handle checked(hid_t id, int (*close)(hid_t), const std::string& field) {
  if (id < 0) throw Hdf5WriteError{field, {}};
  return {id, close};
}

void check(herr_t status, const std::string& field) {
  if (status < 0) throw Hdf5WriteError{field, {}};
}

Hdf5Handle simple_space(const std::vector<std::size_t>& shape, const std::string& field) {
  if (shape.empty()) return checked(H5Screate(H5S_SCALAR), H5Sclose, field);
  const std::vector<hsize_t> dims(shape.begin(), shape.end());
  return checked(H5Screate_simple(static_cast<int>(dims.size()), dims.data(), nullptr), H5Sclose,
                 field);
}

Hdf5Handle text_type(std::size_t bytes, const std::string& field) {
  Hdf5Handle type = checked(H5Tcopy(H5T_C_S1), H5Tclose, field);
  check(H5Tset_size(type.id(), bytes), field);
  check(H5Tset_strpad(type.id(), H5T_STR_NULLPAD), field);
  check(H5Tset_cset(type.id(), H5T_CSET_UTF8), field);
  return type;
}

// Of variable length, which h5py shows as str: for what is not read again.
void write_attribute(hid_t object, const char* name, const char* value) {
  const Hdf5Handle type = text_type(H5T_VARIABLE, name);
  const Hdf5Handle space = simple_space({}, name);
  const Hdf5Handle attribute = checked(
      H5Acreate2(object, name, type.id(), space.id(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose, name);
  check(H5Awrite(attribute.id(), type.id(), &value), name);
}

// Of fixed length, which has its object's checksum: the reader compares it.
void write_unit(hid_t object, const std::string& unit) {
  const Hdf5Handle type = text_type(std::max<std::size_t>(unit.size(), 1), "unit");
  const Hdf5Handle space = simple_space({}, "unit");
  const Hdf5Handle attribute =
      checked(H5Acreate2(object, "unit", type.id(), space.id(), H5P_DEFAULT, H5P_DEFAULT), H5Aclose,
              "unit");
  check(H5Awrite(attribute.id(), type.id(), unit.c_str()), "unit");
}

Hdf5Handle creation_list(const std::vector<std::size_t>& shape, std::size_t bytes,
                         const std::string& field) {
  Hdf5Handle list = checked(H5Pcreate(H5P_DATASET_CREATE), H5Pclose, field);
  check(H5Pset_obj_track_times(list.id(), false), field);  // the same model gives the same bytes
  if (bytes <= kCompactBytes || shape.empty()) {
    check(H5Pset_layout(list.id(), bytes <= kCompactBytes ? H5D_COMPACT : H5D_CONTIGUOUS), field);
    return list;
  }
  std::vector<hsize_t> chunk;
  for (std::size_t i = 0; i < shape.size(); ++i) {
    const std::size_t limit = shape.size() == 3 && i == 0 ? 1
                              : shape.size() == 1         ? 65536
                                                          : kChunkSide;
    chunk.push_back(std::min(shape[i], limit));
  }
  check(H5Pset_chunk(list.id(), static_cast<int>(chunk.size()), chunk.data()), field);
  check(H5Pset_shuffle(list.id()), field);
  check(H5Pset_deflate(list.id(), kDeflateLevel), field);
  check(H5Pset_fletcher32(list.id()), field);
  return list;
}

}  // namespace

Hdf5Handle::Hdf5Handle(std::int64_t id, int (*close)(std::int64_t))
    : id_(new std::int64_t(id), [close](std::int64_t* owned) {
        close(*owned);
        delete owned;
      }) {}

struct Hdf5Session::State {
  std::lock_guard<std::recursive_mutex> lock{hdf5_mutex()};
  H5E_auto2_t printer = nullptr;
  void* printer_data = nullptr;
};

Hdf5Session::Hdf5Session() : state_(std::make_unique<State>()) {
  // After a damaged file or a full disk the library's own clean-up at exit loops and prints; all
  // handles are closed here, so it is not needed. Too late where somebody else opened HDF5 first.
  static const bool unregistered = H5dont_atexit() >= 0;
  static_cast<void>(unregistered);
  H5Eget_auto2(H5E_DEFAULT, &state_->printer, &state_->printer_data);
  H5Eset_auto2(H5E_DEFAULT, nullptr, nullptr);
}

Hdf5Session::~Hdf5Session() { H5Eset_auto2(H5E_DEFAULT, state_->printer, state_->printer_data); }

Hdf5Writer::Hdf5Writer(const std::filesystem::path& path) {
  const Hdf5Handle access = checked(H5Pcreate(H5P_FILE_ACCESS), H5Pclose, "file");
  check(H5Pset_libver_bounds(access.id(), kFileVersion, kFileVersion), "file");
  const Hdf5Handle creation = checked(H5Pcreate(H5P_FILE_CREATE), H5Pclose, "file");
  check(H5Pset_obj_track_times(creation.id(), false), "file");  // of the root group
  file_ =
      checked(H5Fcreate(path.c_str(), H5F_ACC_TRUNC, creation.id(), access.id()), H5Fclose, "file");
  group_ = checked(H5Gopen2(file_.id(), "/", H5P_DEFAULT), H5Gclose, "/");
}

Hdf5Writer::Hdf5Writer(Hdf5Handle group, std::string where)
    : group_(std::move(group)), where_(std::move(where)) {}

void Hdf5Writer::version(const char* format, int number) {
  write_attribute(group_.id(), "format", format);
  const Hdf5Handle space = simple_space({}, "version");
  const Hdf5Handle attribute = checked(
      H5Acreate2(group_.id(), "version", H5T_STD_I32LE, space.id(), H5P_DEFAULT, H5P_DEFAULT),
      H5Aclose, "version");
  check(H5Awrite(attribute.id(), H5T_NATIVE_INT, &number), "version");
}

std::string Hdf5Writer::number_name(std::size_t i) { return fmt::format("{:03}", i); }

Hdf5Writer Hdf5Writer::group(const std::string& name) {
  const Hdf5Handle list = checked(H5Pcreate(H5P_GROUP_CREATE), H5Pclose, name);
  check(H5Pset_obj_track_times(list.id(), false), name);
  return {checked(H5Gcreate2(group_.id(), name.c_str(), H5P_DEFAULT, list.id(), H5P_DEFAULT),
                  H5Gclose, where_ + name),
          where_ + name + "/"};
}

void Hdf5Writer::data_set(const Field& field, std::int64_t type,
                          const std::vector<std::size_t>& shape, const void* values,
                          std::size_t item_bytes) {
  std::size_t bytes = item_bytes;
  for (std::size_t n : shape) bytes *= n;
  const std::string name = where_ + field.name;
  const Hdf5Handle space = simple_space(shape, name);
  const Hdf5Handle list = creation_list(shape, bytes, name);
  const Hdf5Handle data = checked(H5Dcreate2(group_.id(), field.name.c_str(), type, space.id(),
                                             H5P_DEFAULT, list.id(), H5P_DEFAULT),
                                  H5Dclose, name);
  check(H5Dwrite(data.id(), type, H5S_ALL, H5S_ALL, H5P_DEFAULT, values), name);
  write_unit(data.id(), field.unit);
  write_attribute(data.id(), "description", field.description.c_str());
}

// Of shapes that lie in memory: their products do not overflow.
void Hdf5Writer::require_size(const std::string& name, const std::vector<std::size_t>& shape,
                              std::size_t max_values) const {
  const std::size_t values =
      std::accumulate(shape.begin(), shape.end(), std::size_t{1}, std::multiplies<>());
  if (values > max_values)
    throw Hdf5WriteError{where_ + name, fmt::format("{}", fmt::join(shape, " x "))};
}

void Hdf5Writer::number(const Field& field, double value) {
  data_set(field, H5T_IEEE_F64LE, {}, &value, sizeof value);
}

void Hdf5Writer::integer(const Field& field, int value) {
  const std::int64_t wide = value;
  data_set(field, H5T_STD_I64LE, {}, &wide, sizeof wide);
}

void Hdf5Writer::text(const Field& field, const std::string& value) {
  if (value.empty()) return;
  const std::string cut = value.substr(0, kMaxTextBytes);
  const Hdf5Handle type = text_type(cut.size(), where_ + field.name);
  data_set(field, type.id(), {}, cut.data(), cut.size());
}

void Hdf5Writer::texts(const Field& field, const std::vector<std::string>& values) {
  if (values.empty()) return;
  require_size(field.name, {values.size()}, kMaxTexts);
  std::size_t width = 1;
  for (const auto& value : values) width = std::max(width, std::min(value.size(), kMaxTextBytes));
  std::string packed(width * values.size(), '\0');
  for (std::size_t i = 0; i < values.size(); ++i) values[i].copy(packed.data() + i * width, width);
  const Hdf5Handle type = text_type(width, where_ + field.name);
  data_set(field, type.id(), {values.size()}, packed.data(), width);
}

void Hdf5Writer::numbers(const Field& field, const std::vector<double>& values) {
  if (values.empty()) return;
  require_size(field.name, {values.size()}, kMostModelValues);
  data_set(field, H5T_IEEE_F64LE, {values.size()}, values.data(), sizeof(double));
}

void Hdf5Writer::integers(const Field& field, const std::vector<std::int64_t>& values) {
  if (values.empty()) return;
  require_size(field.name, {values.size()}, kMostModelValues);
  data_set(field, H5T_STD_I64LE, {values.size()}, values.data(), sizeof(std::int64_t));
}

void Hdf5Writer::table(const Field& field, const std::vector<std::vector<double>>& rows) {
  if (rows.empty() || rows[0].empty()) return;
  require_size(field.name, {rows.size(), rows[0].size()}, kMostModelValues);
  std::vector<double> flat;
  for (const auto& row : rows) {
    MALUS_REQUIRE(row.size() == rows[0].size());
    flat.insert(flat.end(), row.begin(), row.end());
  }
  data_set(field, H5T_IEEE_F64LE, {rows.size(), rows[0].size()}, flat.data(), sizeof(double));
}

void Hdf5Writer::matrix(const Field& field, const SquareMatrix& matrix) {
  const auto n = static_cast<std::size_t>(matrix.n);
  if (n == 0) return;
  require_size(field.name, {n}, kMaxListItems);
  data_set(field, H5T_IEEE_F64LE, {n, n}, matrix.values.data(), sizeof(double));
}

void Hdf5Writer::image(const Field& field, const Image& image) {
  if (image.empty()) return;
  const std::vector<std::size_t> shape = {static_cast<std::size_t>(image.rows()),
                                          static_cast<std::size_t>(image.cols())};
  require_size(field.name, shape, kMaxImagePixels);
  data_set(field, H5T_IEEE_F32LE, shape, image.values().data(), sizeof(float));
}

void Hdf5Writer::images(const Field& field, const std::vector<Image>& images) {
  if (images.empty() || images[0].empty()) return;
  const auto rows = static_cast<std::size_t>(images[0].rows()),
             cols = static_cast<std::size_t>(images[0].cols());
  require_size(field.name, {images.size()}, kMaxImages);
  require_size(field.name, {rows, cols}, kMaxImagePixels);
  std::vector<float> stack;
  for (const Image& image : images) {
    MALUS_REQUIRE(image.rows() == images[0].rows() && image.cols() == images[0].cols());
    stack.insert(stack.end(), image.values().begin(), image.values().end());
  }
  data_set(field, H5T_IEEE_F32LE, {images.size(), rows, cols}, stack.data(), sizeof(float));
}

void Hdf5Writer::close() {
  check(H5Fflush(file_.id(), H5F_SCOPE_GLOBAL), "file");
  group_ = {};
  file_ = {};
}

}  // namespace malus::internal
