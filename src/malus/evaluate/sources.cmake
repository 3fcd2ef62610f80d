set(evaluate_SOURCES)
