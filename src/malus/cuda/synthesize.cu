#include "malus/base/error.h"
#include "malus/cuda/device.h"
#include "malus/cuda/draw_plan.h"
#include "malus/cuda/synthesize.h"
#include "malus/synthesize/scalar_formation.h"

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

// One thread draws the two pixels of one Philox block (plan_draw).
__global__ void draw_noise(DrawFrame f, FormationTables tables, const CompiledChannel* channels,
                           const float* row_deviate) {
  using A = scalar::Arithmetic;
  const int r = static_cast<int>(blockIdx.y * blockDim.y + threadIdx.y);
  if (r >= f.rows) return;
  const int row = f.row0 + r;
  const auto block = static_cast<std::uint32_t>(f.col0) / kGroupColumns * 16u +
                     blockIdx.x * blockDim.x + threadIdx.x;
  const int first = static_cast<int>(block / 16u * kGroupColumns + block % 16u) - f.col0;
  if (first >= f.cols) return;
  const std::uint64_t index = std::uint64_t{static_cast<std::uint32_t>(row)} << 32 | block;
  const PhiloxBlock words = random_block(f.seed, f.frame, index, Draw::kPixel);
  for (int half = 0; half < 2; ++half) {
    const int c = first + 16 * half;
    if (c < 0 || c >= f.cols) continue;
    const CompiledChannel& p =
        channels[row % f.cell_rows * f.cell_cols + (f.col0 + c) % f.cell_cols];
    const scalar::ChannelLanes<A> lanes{p.gain_dn,
                                        p.electrons_per_dn,
                                        p.variance_dn2,
                                        p.scale_dn,
                                        p.mu_dn + p.sigma_row_dn * row_deviate[r],
                                        p.first_line - kTailFirst};
    f.out[r * f.out_stride + c] = scalar::noisy_pixel<A>(
        f.in[r * f.in_stride + c], lanes, tables, words.word[2 * half], words.word[2 * half + 1]);
  }
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
  draw_noise<<<dim3(grid.blocks_x, grid.blocks_y), dim3(grid.threads_x, grid.threads_y)>>>(
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

DeviceRates measure_rates(const CompiledNoise& noise, int rows, int cols) {
  const DeviceNoise device(noise);
  const auto pixels = static_cast<std::size_t>(rows) * static_cast<std::size_t>(cols);
  const DeviceArray<float> clean(std::vector<float>(pixels, 500.0f)), noisy(pixels);
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
