"""Evaluations on pairs that had no part in development, which compare methods.

`pair_set.py` has the pairs, and the experiments that register batches of them; `steps.py` has Table 1. Each has a
section of its own.
"""
