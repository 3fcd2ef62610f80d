set(synthesize_SOURCES compiled.cpp compiled_kernel.cpp dataset.cpp exact.cpp gain_tables.cpp level_sampler.cpp model.cpp pairs.cpp quantile_table.cpp renoise.cpp scene.cpp synthesizer.cpp)
