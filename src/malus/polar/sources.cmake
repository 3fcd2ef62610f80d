set(polar_SOURCES)
