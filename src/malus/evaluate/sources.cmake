set(evaluate_SOURCES
  evaluation.cpp
  image_metrics.cpp
  polarization_metrics.cpp
)
