"""Whole surveys, mapped by this project and by other systems.

`simulated.py` makes the scans, `mapped.py` maps them in a process of their own, `row.py` compares the result with the
truth, `section.py` shows it.
"""
