set(synthesize_SOURCES)
