set(calibrate_SOURCES)
