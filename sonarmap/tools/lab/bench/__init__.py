"""Benchmarks: kernels beside their NumPy and SciPy twins, and the time of preparing and registering pairs.

In: a device, voxels per edge, a seed. Out: a `BenchResult`, as a table or as JSON. `cases/` has one case per kernel,
`twins.py` the same computations on the host, `pairs.py` times registrations; docs/benchmarks.md shows the figures.
"""
