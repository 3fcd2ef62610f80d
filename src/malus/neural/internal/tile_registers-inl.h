// Intel's matrix unit: eight registers of up to 16 rows of 64 bytes, whose shapes are set
// beforehand, and one instruction that adds the products of 16 rows of 32 rounded values with 16
// columns of them to 256 sums in float32. The including file sets the target and a namespace of its
// own; no include guard, as product-inl.h.

constexpr std::ptrdiff_t kTileRows = 16, kFloatBytes = sizeof(float);
// Inner values of an instruction.
constexpr std::ptrdiff_t kDepth = 32;

// What ldtilecfg reads.
struct alignas(64) TileShapes {
  std::uint8_t palette = 1, start_row = 0, reserved[14] = {};
  std::uint16_t row_bytes[16] = {};
  std::uint8_t rows[16] = {};
};

HWY_INLINE void shape_tile(TileShapes& shapes, int tile, std::ptrdiff_t rows,
                           std::ptrdiff_t row_bytes) {
  shapes.rows[tile] = static_cast<std::uint8_t>(rows);
  shapes.row_bytes[tile] = static_cast<std::uint16_t>(row_bytes);
}

// The unit's instructions. Those of the compiler take literal numbers of registers only, and GCC
// 12's do not say how much memory they read.
HWY_INLINE void use_shapes(const TileShapes& shapes) {
  asm volatile("ldtilecfg %0" : : "m"(shapes));
}
HWY_INLINE void release_tiles() { asm volatile("tilerelease"); }
template <int kTile>
HWY_INLINE void clear() {
  asm volatile("tilezero %%tmm%c0" : : "i"(kTile));
}
template <int kTile>
HWY_INLINE void load(const void* from, std::ptrdiff_t row_bytes) {
  asm volatile("tileloadd (%0,%1,1), %%tmm%c2"
               :
               : "r"(from), "r"(row_bytes), "i"(kTile)
               : "memory");
}
template <int kTile>
HWY_INLINE void store(void* to, std::ptrdiff_t row_bytes) {
  asm volatile("tilestored %%tmm%c2, (%0,%1,1)" : : "r"(to), "r"(row_bytes), "i"(kTile) : "memory");
}
template <int kSums, int kA, int kB>
HWY_INLINE void multiply_add() {
  asm volatile("tdpbf16ps %%tmm%c0, %%tmm%c1, %%tmm%c2" : : "i"(kB), "i"(kA), "i"(kSums));
}
