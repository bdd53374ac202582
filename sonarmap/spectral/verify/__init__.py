"""Rotations in, a few tested hypotheses out: each with its pose and all that was measured of it.

`hypothesis_testing.py` runs the test of one pair: `bounds.py` says which poses are possible, `verifier.py` finds
candidate poses under each rotation and measures them, `icp.py` refines them, with what instruments measured (`fit.py`),
`relief.py` compares beds. `spectral/judgement.py` says what a `hypothesis.py` is worth.
"""
