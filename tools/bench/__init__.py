"""Benchmarks: kernels beside their NumPy and SciPy twins, and prepared pairs (docs/benchmarks.md)."""
