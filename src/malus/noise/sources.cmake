set(noise_SOURCES builtin_models.cpp data_sheet.cpp distribution.cpp internal/hdf5_reader.cpp internal/hdf5_writer.cpp internal/published_cameras.cpp interpolate_kinds.cpp joint_gain.cpp level_noise.cpp matrix.cpp
    model.cpp model_check.cpp model_file.cpp model_sampling.cpp noise_law.cpp physics.cpp row_drift.cpp same_sensor.cpp stabilize.cpp tukey_lambda.cpp variance_curve.cpp)
