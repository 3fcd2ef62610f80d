set(cuda_SOURCES device.cpp draw_plan.cpp measure_rates.cpp)
