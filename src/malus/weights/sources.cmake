set(weights_SOURCES
  pickle.cpp
  safetensors.cpp
  stored_zip.cpp
  torch_archive.cpp
)
