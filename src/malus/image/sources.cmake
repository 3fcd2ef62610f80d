set(image_SOURCES black_levels.cpp frame_statistics.cpp layout.cpp middle.cpp pack.cpp quantization.cpp raw_frame.cpp)
