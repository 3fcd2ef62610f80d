set(base_SOURCES atomic_file.cpp error.cpp frame_numbers.cpp large_pages.cpp parallel.cpp progress.cpp random.cpp statistics.cpp text.cpp unfinished_files.cpp unreadable_file.cpp worker_place.cpp)
