set(image_SOURCES layout.cpp pack.cpp raw_frame.cpp)
