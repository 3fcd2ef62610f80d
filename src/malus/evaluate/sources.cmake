set(evaluate_SOURCES
  divergence.cpp
  evaluation.cpp
  image_metrics.cpp
  noise_comparison.cpp
  noise_structure.cpp
  polarization_metrics.cpp
)
