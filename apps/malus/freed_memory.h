// What the program has glibc do with memory that is freed. One setting for the whole process, made
// by a command before it works; nothing on systems without glibc.
#pragma once

namespace malus::app {

/// All of it is kept for the next request: networks take and free memory with every layer.
void keep_freed_memory();

/// Blocks of up to 32 MiB are kept, the planes of 5 megapixels. The denoiser makes and frees some
/// twenty of them, and the system clears every one that it hands out.
void keep_freed_planes();

/// Blocks of 1 MiB and more go back to the system at once. Planes of 20 MB come and go with every
/// frame of a calibration: they cannot leave holes in the heap then (80 MB less on 5 megapixels).
void return_freed_planes();

}  // namespace malus::app
