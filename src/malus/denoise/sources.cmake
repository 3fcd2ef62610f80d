set(denoise_SOURCES bm3d.cpp bm3d_filter.cpp bm3d_match.cpp bm3d_parameters.cpp bm3d_pass.cpp)
