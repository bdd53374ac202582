"""Benchmarks of the kernels against their NumPy and SciPy twins, of preparing and registering pairs, and of a survey.

`run.py` measures on a device and returns one result, which `--json` prints and `table.py` formats. `*_cases.py` define
a case per kernel, `twins.py` the same work on the host; results are in docs/measured/benchmarks.md.
"""
