set(cuda_SOURCES device.cpp)
