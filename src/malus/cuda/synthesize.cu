#include "malus/base/error.h"
#include "malus/cuda/device.h"
#include "malus/cuda/internal/device_memory.h"
#include "malus/cuda/internal/draw_plan.h"
#include "malus/cuda/internal/lane_arithmetic.h"
#include "malus/cuda/synthesize.h"

#include <array>
#include <vector>

#include <cuda_runtime.h>

namespace malus::cuda {
namespace {

// Blocks of a multiprocessor at least: leaves a thread 64 registers, which every usual model's
// kernel gets by with; two rows in step, which need more, were slower on an H100 (153 Gpx/s of
// physics against 170).
constexpr int kBlocksLeast = 4;

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

// What a thread draws: lane i is half i of its Philox block, mosaic columns 16 apart, row by row.
struct ThreadPixels {
  std::uint32_t block;
  int col;        // lane 0's, in the mosaic
  int row, past;  // the first, and the one past the last
  int end[2];     // past, for each lane; 0 where its column is outside
};

__device__ __forceinline__ int column_in_frame(const DrawFrame& f, const ThreadPixels& t) {
  return t.col - f.col0;
}

__device__ __forceinline__ ThreadPixels pixels_of_thread(const DrawFrame& f) {
  ThreadPixels t;
  t.block = static_cast<std::uint32_t>(f.col0) / kGroupColumns * 16u + blockIdx.x * blockDim.x +
            threadIdx.x;
  t.col = static_cast<int>(t.block / 16u * kGroupColumns + t.block % 16u);
  t.row =
      static_cast<int>(blockIdx.y * blockDim.y) * f.rows_per_thread + static_cast<int>(threadIdx.y);
  t.past = min(f.rows, t.row + f.rows_apart * f.rows_per_thread);
  for (int i = 0; i < 2; ++i) {
    const int col = column_in_frame(f, t) + 16 * i;
    t.end[i] = col >= 0 && col < f.cols ? t.past : 0;
  }
  return t;
}

// The channels of a thread's lanes: one for all rows, and unless kAny one for both lanes too.
template <DrawKernel kKernel>
__device__ __forceinline__ Lanes<CompiledChannel> channels_of_lanes(const DrawFrame& f,
                                                                    const CompiledChannel* channels,
                                                                    const ThreadPixels& t) {
  const CompiledChannel* cells = channels + (f.row0 + t.row) % f.cell_rows * f.cell_cols;
  Lanes<CompiledChannel> p;
  p.v[0] = p.v[1] = cells[t.col % f.cell_cols];
  if constexpr (kKernel == DrawKernel::kAny) p.v[1] = cells[(t.col + 16) % f.cell_cols];
  return p;
}

template <class Member>
__device__ __forceinline__ auto member_of(const Lanes<CompiledChannel>& p, Member member) {
  return each_lane([&](int i) { return p.v[i].*member; });
}

// All but the offset, which every row changes.
__device__ __forceinline__ ChannelLanes<LaneArithmetic> formation_of(
    const Lanes<CompiledChannel>& p) {
  return {member_of(p, &CompiledChannel::gain_dn),
          member_of(p, &CompiledChannel::electrons_per_dn),
          member_of(p, &CompiledChannel::variance_dn2),
          member_of(p, &CompiledChannel::scale_dn),
          {},
          member_of(p, &CompiledChannel::first_line) + LaneArithmetic::word(0u - kTailFirst)};
}

__device__ __forceinline__ Lanes<float> load_pixels(const float* in, const ThreadPixels& t,
                                                    int row) {
  return each_lane([&](int i) { return row < t.end[i] ? in[16 * i] : 0.0f; });
}

__device__ __forceinline__ void store_pixels(const Lanes<float>& noisy_dn, float* out,
                                             const ThreadPixels& t, int row) {
#pragma unroll
  for (int i = 0; i < 2; ++i)
    if (row < t.end[i]) out[16 * i] = noisy_dn.v[i];
}

// The words of a row's two pixels (pixel_words in formation.h).
__device__ __forceinline__ void draw_words(const DrawFrame& f, const ThreadPixels& t, int row,
                                           Lanes<std::uint32_t>& shot, Lanes<std::uint32_t>& read) {
  const std::uint64_t index = pixel_index(f.row0 + row, static_cast<int>(t.block));
  const PhiloxBlock words = random_block(f.keys, f.frame, index, Draw::kPixel);
  shot = {{words.word[0], words.word[2]}};
  read = {{words.word[1], words.word[3]}};
}

// The compiler may not compute the value again in every row to save a register.
template <class T>
__device__ __forceinline__ void keep(T& value) {
  asm volatile("" : "+r"(value));
}

// A thread of plan_draw's grid; in and out may be the same memory.
template <DrawKernel kKernel>
__global__ void __launch_bounds__(kThreadsMost, kBlocksLeast)
    draw_noise(DrawFrame f, FormationTables all_tables, const CompiledChannel* channels,
               const float* row_deviate) {
  ThreadPixels t = pixels_of_thread(f);
  const int first = column_in_frame(f, t);
  if (first >= f.cols || t.row >= f.rows) return;
  const typename TablesOf<kKernel>::Type tables(all_tables);
  const auto p = channels_of_lanes<kKernel>(f, channels, t);
  const auto mu_dn = member_of(p, &CompiledChannel::mu_dn);
  const auto sigma_row_dn = member_of(p, &CompiledChannel::sigma_row_dn);
  auto formation = formation_of(p);
  const float* in = f.in + t.row * f.in_stride + first;
  float* out = f.out + t.row * f.out_stride + first;
  const float* deviate = row_deviate + t.row;
  keep(t.block);
  keep(t.end[0]);
  keep(t.end[1]);
  Lanes<float> next = load_pixels(in, t, t.row);
#pragma unroll 1
  for (int row = t.row; row < t.past; row += f.rows_apart) {
    const Lanes<float> signal_dn = next;
    // The next row's pixels arrive while these are drawn.
    in += f.in_step;
    next = load_pixels(in, t, row + f.rows_apart);
    Lanes<std::uint32_t> shot, read;
    draw_words(f, t, row, shot, read);
    // In this order: with the step after its use nvcc 13 makes six instructions more.
    const auto z = LaneArithmetic::real(*deviate);
    deviate += f.rows_apart;
    formation.offset_dn = mu_dn + sigma_row_dn * z;
    store_pixels(noisy_pixel<LaneArithmetic>(signal_dn, formation, tables, shot, read), out, t,
                 row);
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
  explicit Tables(const CompiledParts& compiled)
      : parts(compiled),
        channels(parts.channels),
        normal(normal_tail_lines()),
        read(parts.read_lines ? DeviceArray<TailLine>(*parts.read_lines)
                              : DeviceArray<TailLine>()) {}

  CompiledParts parts;
  DeviceArray<CompiledChannel> channels;
  DeviceArray<TailLine> normal, read;
  // Kept from call to call, because allocating would stop the device. Two host buffers take turns,
  // so that one is written while the device may still read the other; the device's one buffer needs
  // no turns, because a stream's copies and kernels run in order.
  DeviceArray<float> row_deviate;
  std::size_t rows_held = 0;
  std::array<SendBuffer, 2> outgoing;
  unsigned turn = 0;
};

DeviceNoise::DeviceNoise(const CompiledNoise& noise) {
  check_status(device_available() ? cudaSuccess : cudaErrorNoDevice, "looking for a device");
  tables_ = std::make_unique<Tables>(noise.parts());
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
  if (plan.row_deviate.size() > tables_->rows_held) {
    tables_->row_deviate = DeviceArray<float>(plan.row_deviate.size());
    tables_->rows_held = plan.row_deviate.size();
  }
  tables_->outgoing[tables_->turn++ % 2].send(plan.row_deviate, tables_->row_deviate.get());
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

}  // namespace malus::cuda
