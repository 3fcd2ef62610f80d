set(denoise_SOURCES)
