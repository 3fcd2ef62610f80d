set(capture_SOURCES camera.cpp capture.cpp frame_writer.cpp plan.cpp)
