set(neural_SOURCES frame_domain.cpp hybrid.cpp inference.cpp layers.cpp loss.cpp nafnet.cpp network.cpp package.cpp restormer.cpp safetensors.cpp uformer.cpp unet.cpp threads.cpp tiles.cpp)
