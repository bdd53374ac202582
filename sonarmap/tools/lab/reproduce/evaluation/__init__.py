"""Evaluations on pairs that had no part in development, which compare methods.

`pair_set.py` has the pairs, and how batches of them are registered; `steps.py`, `pairs.py`, `unrelated.py` and
`speed.py` are the experiments, each with a section of its own.
"""
