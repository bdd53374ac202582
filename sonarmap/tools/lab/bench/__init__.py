"""Benchmarks of the kernels, of preparing and registering pairs, and of a survey.

`run.py` measures on a device and returns one result, which `--json` prints and `table.py` formats. `cases.py` defines
a case per kernel; results are in docs/measured/benchmarks.md.
"""
