set(polar_SOURCES layout_check.cpp stokes.cpp)
