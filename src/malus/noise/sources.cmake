set(noise_SOURCES physics.cpp profile.cpp tukey_lambda.cpp)
