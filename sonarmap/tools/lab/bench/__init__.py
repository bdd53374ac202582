"""Benchmarks: kernels beside their NumPy and SciPy twins, and the time of preparing and registering pairs.

In: a device, voxels per edge, a seed. Out: one result, which `--json` prints and `table.py` shows. The
`*_cases.py` have one case per kernel, `twins.py` the same work on the host; docs/measured/benchmarks.md has results.
"""
