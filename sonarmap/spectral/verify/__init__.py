"""Rotations in, a few tested hypotheses out: each with its pose and its evidence.

`hypothesis_testing.py` runs the test of one pair: `bounds.py` limits the search, `verifier.py` finds candidate poses
under each rotation and measures them, `icp.py` refines them together with the measurements of instruments (`fit.py`),
`relief.py` compares beds by height; `rehearsal.py` compiles their kernels ahead. `spectral/judgement.py` computes the
probability of a `Hypothesis`.
"""
