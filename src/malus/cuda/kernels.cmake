set(cuda_KERNELS synthesize.cu rounding.cu)
