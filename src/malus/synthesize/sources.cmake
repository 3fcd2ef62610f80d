set(synthesize_SOURCES compiled.cpp compiled_kernel.cpp exact.cpp quantile_table.cpp)
