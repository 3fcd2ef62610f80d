#include "malus/base/error.h"
#include "malus/cuda/device.h"
#include "malus/cuda/draw_plan.h"
#include "malus/cuda/lane_arithmetic.h"
#include "malus/cuda/synthesize.h"

#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include <cuda_runtime.h>

namespace malus::cuda {
namespace {

template <class T>
class DeviceArray {
 public:
  DeviceArray() = default;
  explicit DeviceArray(std::size_t count) {
    if (count > 0) check_status(cudaMalloc(&data_, count * sizeof(T)), "allocating memory");
  }
  explicit DeviceArray(const std::vector<T>& values) : DeviceArray(values.size()) {
    if (!values.empty())
      check_status(
          cudaMemcpy(data_, values.data(), values.size() * sizeof(T), cudaMemcpyHostToDevice),
          "copying to the device");
  }
  ~DeviceArray() { cudaFree(data_); }
  DeviceArray(DeviceArray&& other) noexcept : data_(std::exchange(other.data_, nullptr)) {}
  DeviceArray& operator=(DeviceArray&& other) noexcept {
    std::swap(data_, other.data_);
    return *this;
  }
  T* get() const { return data_; }

 private:
  T* data_ = nullptr;
};

#ifndef MALUS_MIN_BLOCKS
#define MALUS_MIN_BLOCKS 4
#endif
// FormationTables whose switches the compiler knows.
template <ShotKind kShot, bool kRead, bool kSteps>
struct KnownTables {
  static constexpr ShotKind shot = kShot;
  const TailLine *normal, *read;
  float quantization_dn;
  __device__ explicit KnownTables(const FormationTables& tables)
      : normal(tables.normal), read(tables.read), quantization_dn(tables.quantization_dn) {}
  __device__ static constexpr bool has_read() { return kRead; }
  __device__ static constexpr bool quantizes() { return kSteps; }
};

template <DrawKernel>
struct TablesOf {
  using Type = FormationTables;
};
template <>
struct TablesOf<DrawKernel::kPoissonSteps> {
  using Type = KnownTables<ShotKind::kPoisson, true, true>;
};
template <>
struct TablesOf<DrawKernel::kPoisson> {
  using Type = KnownTables<ShotKind::kPoisson, true, false>;
};
template <>
struct TablesOf<DrawKernel::kGaussianSteps> {
  using Type = KnownTables<ShotKind::kGaussian, false, true>;
};
template <>
struct TablesOf<DrawKernel::kGaussian> {
  using Type = KnownTables<ShotKind::kGaussian, false, false>;
};

// Lane i of a thread is half i % 2 of its Philox block in row i / 2 of its set.
constexpr int kLanes = 2 * kRowsInStep;
using Arithmetic = LaneArithmetic<kLanes>;

// The channels of a thread's lanes: one for all rows, and unless kAny one for both halves too.
template <DrawKernel kKernel>
__device__ __forceinline__ Lanes<CompiledChannel, kLanes> channels_of_lanes(
    const DrawFrame& f, const CompiledChannel* channels, int row, int col) {
  const CompiledChannel* cells = channels + row % f.cell_rows * f.cell_cols;
  CompiledChannel half[2];
  half[0] = half[1] = cells[col % f.cell_cols];
  if constexpr (kKernel == DrawKernel::kAny)
    half[1] = cells[(col + kGroupColumns / 2) % f.cell_cols];
  return each_lane<kLanes>([&](int i) { return half[i % 2]; });
}

template <class Member>
__device__ __forceinline__ auto member_of(const Lanes<CompiledChannel, kLanes>& p, Member member) {
  return each_lane<kLanes>([&](int i) { return p.v[i].*member; });
}

// The compiler may not compute the value again in every row to save a register.
template <class T>
__device__ __forceinline__ void keep(T& value) {
  asm volatile("" : "+r"(value));
}

// A thread of plan_draw's grid; in and out may be the same memory.
template <DrawKernel kKernel>
__global__ void __launch_bounds__(kThreadsMost, MALUS_MIN_BLOCKS)
    draw_noise(DrawFrame f, FormationTables all_tables, const CompiledChannel* channels,
               const float* row_deviate) {
  auto block = static_cast<std::uint32_t>(f.col0) / kGroupColumns * 16u + blockIdx.x * blockDim.x +
               threadIdx.x;
  const int col = static_cast<int>(block / 16u * kGroupColumns + block % 16u);
  const int first = col - f.col0;
  int r = static_cast<int>(blockIdx.y * blockDim.y) * f.row_sets * kRowsInStep +
          static_cast<int>(threadIdx.y);
  if (first >= f.cols || r >= f.rows) return;
  const typename TablesOf<kKernel>::Type tables(all_tables);
  const auto p = channels_of_lanes<kKernel>(f, channels, f.row0 + r, col);
  const auto sigma_row_dn = member_of(p, &CompiledChannel::sigma_row_dn);
  const auto mu_dn = member_of(p, &CompiledChannel::mu_dn);
  ChannelLanes<Arithmetic> lanes{
      member_of(p, &CompiledChannel::gain_dn),
      member_of(p, &CompiledChannel::electrons_per_dn),
      member_of(p, &CompiledChannel::variance_dn2),
      member_of(p, &CompiledChannel::scale_dn),
      mu_dn,
      member_of(p, &CompiledChannel::first_line) + Arithmetic::word(0u - kTailFirst)};
  const float* in = f.in + r * f.in_stride + first;
  float* out = f.out + r * f.out_stride + first;
  const float* deviates = row_deviate + r;
  // Row past the last of each half; none where the column is outside.
  const int past = min(f.rows, r + f.rows_apart * f.row_sets * kRowsInStep);
  int end[2] = {first >= 0 ? past : 0, first + 16 >= 0 && first + 16 < f.cols ? past : 0};
  keep(block);
  keep(end[0]);
  keep(end[1]);
  const auto load = [&](int row) {
    return each_lane<kLanes>([&](int i) {
      return row + i / 2 * f.rows_apart < end[i % 2]
                 ? in[i / 2 * f.rows_apart * f.in_stride + i % 2 * 16]
                 : 0.0f;
    });
  };
  Lanes<float, kLanes> next = load(r);
#pragma unroll 1
  for (; r < past; r += f.rows_apart * kRowsInStep) {
    const Lanes<float, kLanes> signal_dn = next;
    // The next rows' pixels arrive while these are drawn.
    in += f.in_step;
    next = load(r + f.rows_apart * kRowsInStep);
    Lanes<std::uint32_t, kLanes> shot, read;
    Lanes<float, kLanes> deviate;
#pragma unroll
    for (int k = 0; k < kRowsInStep; ++k) {
      const int row = r + k * f.rows_apart;
      const std::uint64_t index =
          std::uint64_t{static_cast<std::uint32_t>(f.row0 + row)} << 32 | block;
      const PhiloxBlock words = random_block(f.keys, f.frame, index, Draw::kPixel);
      shot.v[2 * k] = words.word[0];
      read.v[2 * k] = words.word[1];
      shot.v[2 * k + 1] = words.word[2];
      read.v[2 * k + 1] = words.word[3];
      deviate.v[2 * k] = deviate.v[2 * k + 1] =
          kRowsInStep == 1 || row < past ? deviates[k * f.rows_apart] : 0.0f;
    }
    deviates += f.rows_apart * kRowsInStep;
    lanes.offset_dn = mu_dn + sigma_row_dn * deviate;
    const auto noisy_dn = noisy_pixel<Arithmetic>(signal_dn, lanes, tables, shot, read);
#pragma unroll
    for (int i = 0; i < kLanes; ++i)
      if (r + i / 2 * f.rows_apart < end[i % 2])
        out[i / 2 * f.rows_apart * f.out_stride + i % 2 * 16] = noisy_dn.v[i];
    out += f.out_step;
  }
}

// draw_noise for a plan's kernel.
auto kernel_of(DrawKernel kernel) {
  switch (kernel) {
    case DrawKernel::kPoissonSteps:
      return draw_noise<DrawKernel::kPoissonSteps>;
    case DrawKernel::kPoisson:
      return draw_noise<DrawKernel::kPoisson>;
    case DrawKernel::kGaussianSteps:
      return draw_noise<DrawKernel::kGaussianSteps>;
    case DrawKernel::kGaussian:
      return draw_noise<DrawKernel::kGaussian>;
    case DrawKernel::kAny:
      break;
  }
  return draw_noise<DrawKernel::kAny>;
}

}  // namespace

struct DeviceNoise::Tables {
  CompiledParts parts;
  DeviceArray<CompiledChannel> channels;
  DeviceArray<TailLine> normal, read;
  DeviceArray<float> row_deviate;  // kept from call to call: allocating would stop the device
  int rows_held = 0;
};

DeviceNoise::DeviceNoise(const CompiledNoise& noise) {
  check_status(device_available() ? cudaSuccess : cudaErrorNoDevice, "looking for a device");
  const CompiledParts& parts = noise.parts();
  tables_ = std::make_unique<Tables>(Tables{
      parts, DeviceArray<CompiledChannel>(parts.channels),
      DeviceArray<TailLine>(normal_tail_lines()),
      parts.read_lines ? DeviceArray<TailLine>(*parts.read_lines) : DeviceArray<TailLine>()});
}

DeviceNoise::~DeviceNoise() = default;
DeviceNoise::DeviceNoise(DeviceNoise&&) noexcept = default;
DeviceNoise& DeviceNoise::operator=(DeviceNoise&&) noexcept = default;

void DeviceNoise::apply_on_device(const float* clean_dn, std::ptrdiff_t clean_stride,
                                  float* noisy_dn, std::ptrdiff_t noisy_stride, int rows, int cols,
                                  const DrawAddress& address) const {
  if (rows == 0 || cols == 0) return;
  const CompiledParts& parts = tables_->parts;
  const DrawPlan plan =
      plan_draw(parts, clean_dn, clean_stride, noisy_dn, noisy_stride, rows, cols, address);
  if (rows > tables_->rows_held) {
    tables_->row_deviate = DeviceArray<float>(plan.row_deviate.size());
    tables_->rows_held = rows;
  }
  check_status(cudaMemcpy(tables_->row_deviate.get(), plan.row_deviate.data(),
                          plan.row_deviate.size() * sizeof(float), cudaMemcpyHostToDevice),
               "copying to the device");
  const FormationTables tables{tables_->normal.get(), tables_->read.get(), parts.shot,
                               parts.quantization_dn};
  const DrawGrid& grid = plan.grid;
  kernel_of(
      plan.kernel)<<<dim3(grid.blocks_x, grid.blocks_y), dim3(grid.threads_x, grid.threads_y)>>>(
      plan.frame, tables, tables_->channels.get(), tables_->row_deviate.get());
  check_status(cudaGetLastError(), "starting the kernel");
}

void DeviceNoise::apply(View<const float> clean_dn, View<float> noisy_dn,
                        const DrawAddress& address) const {
  MALUS_REQUIRE(clean_dn.rows() == noisy_dn.rows() && clean_dn.cols() == noisy_dn.cols());
  if (clean_dn.empty()) return;
  const auto rows = static_cast<std::size_t>(clean_dn.rows());
  const auto cols = static_cast<std::size_t>(clean_dn.cols());
  const DeviceArray<float> pixels(rows * cols);
  const std::size_t width = cols * sizeof(float);
  const auto pitch = [](std::ptrdiff_t stride) {
    return static_cast<std::size_t>(stride) * sizeof(float);
  };
  check_status(cudaMemcpy2D(pixels.get(), width, clean_dn.data(), pitch(clean_dn.stride()), width,
                            rows, cudaMemcpyHostToDevice),
               "copying to the device");
  apply_on_device(pixels.get(), clean_dn.cols(), pixels.get(), clean_dn.cols(), clean_dn.rows(),
                  clean_dn.cols(), address);
  check_status(cudaMemcpy2D(noisy_dn.data(), pitch(noisy_dn.stride()), pixels.get(), width, width,
                            rows, cudaMemcpyDeviceToHost),
               "copying from the device");
}

namespace {

// Seconds of work(), by the device's clock; the median of several.
template <class Work>
double device_seconds(const Work& work) {
  constexpr int kRepetitions = 21;
  cudaEvent_t start{}, stop{};
  check_status(cudaEventCreate(&start), "timing");
  check_status(cudaEventCreate(&stop), "timing");
  std::vector<float> times;
  for (int i = 0; i < kRepetitions; ++i) {
    check_status(cudaEventRecord(start), "timing");
    work();
    check_status(cudaEventRecord(stop), "timing");
    check_status(cudaEventSynchronize(stop), "timing");
    times.push_back(0);
    check_status(cudaEventElapsedTime(&times.back(), start, stop), "timing");
  }
  cudaEventDestroy(start);
  cudaEventDestroy(stop);
  std::nth_element(times.begin(), times.begin() + kRepetitions / 2, times.end());
  return 1e-3 * static_cast<double>(times[kRepetitions / 2]);
}

}  // namespace

DeviceRates measure_rates(const CompiledNoise& noise, int rows, int cols, double top_dn) {
  const DeviceNoise device(noise);
  const auto pixels = static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
  std::vector<float> signals_dn(pixels);
  for (std::size_t i = 0; i < pixels; ++i)
    signals_dn[i] =
        static_cast<float>(top_dn * uniform_open(static_cast<std::uint32_t>(i) * 2654435761u));
  const DeviceArray<float> clean(signals_dn), noisy(pixels);
  const double drawn_s = device_seconds([&] {
    device.apply_on_device(clean.get(), cols, noisy.get(), cols, rows, cols, {.seed = 1});
  });
  const double copied_s = device_seconds([&] {
    check_status(
        cudaMemcpyAsync(noisy.get(), clean.get(), pixels * sizeof(float), cudaMemcpyDeviceToDevice),
        "copying on the device");
  });
  return {static_cast<double>(pixels) / drawn_s, static_cast<double>(pixels) / copied_s};
}

}  // namespace malus::cuda
