"""Evaluations on pairs that had no part in development, which compare methods.

`pair_set.py` has the pairs, and the experiments that register batches of them; `steps.py`, `neighbors.py` and
`speed.py` are the others. Each has a section of its own.
"""
