set(neural_SOURCES hybrid.cpp layers.cpp loss.cpp nafnet.cpp network.cpp restormer.cpp safetensors.cpp uformer.cpp unet.cpp)
