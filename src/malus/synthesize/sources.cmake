set(synthesize_SOURCES exact.cpp)
