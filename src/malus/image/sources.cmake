set(image_SOURCES frame_statistics.cpp layout.cpp middle.cpp pack.cpp raw_frame.cpp)
