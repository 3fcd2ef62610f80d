set(base_SOURCES error.cpp parallel.cpp progress.cpp random.cpp statistics.cpp text.cpp)
