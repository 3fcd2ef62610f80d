set(io_SOURCES)
