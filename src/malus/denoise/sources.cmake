set(denoise_SOURCES bm3d.cpp bm3d_parameters.cpp)
