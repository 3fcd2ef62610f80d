set(cuda_KERNELS synthesize.cu)
