set(polar_SOURCES color_map.cpp layout_check.cpp legend.cpp render.cpp stokes.cpp symmetry.cpp uncertainty.cpp)
