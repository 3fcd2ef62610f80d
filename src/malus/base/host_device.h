// Functions whose one source serves CPU and GPU.
#pragma once

#if defined(__CUDACC__)
#define MALUS_HOST_DEVICE __host__ __device__
#else
#define MALUS_HOST_DEVICE
#endif
