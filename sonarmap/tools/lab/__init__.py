"""The laboratory: simulated sonars, scores, other methods, experiments and benchmarks."""
