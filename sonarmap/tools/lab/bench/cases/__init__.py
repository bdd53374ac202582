"""One function per kernel that makes its benchmark case: input, kernel, twin and tolerance.

A new case is a function of a `Workload` and a line in `all_cases.py`.
"""
