set(image_SOURCES black_levels.cpp digital_gain.cpp finite_pixels.cpp frame_mean.cpp frame_statistics.cpp layout.cpp middle.cpp pack.cpp quantization.cpp raw_frame.cpp seen_frames.cpp window.cpp)
