"""Rotations in, a few tested hypotheses out: each with its pose, its evidence, its covariance and its probability.

`hypothesis_testing.py` runs the test of one pair: `bounds.py` says which poses are possible, `verifier.py` finds
candidate poses under each rotation (`candidates.py`), `icp.py` refines them, with what instruments measured
(`pair_frames.py`, `prior_term.py`), and the verifier reads their evidence (`hypothesis.py`, `shared_surface.py`).
`covariance.py`, with the numbers of `calibration.py`, and `probability.py` say how sure the result is. Only
`spectral/registration.py` imports this package.
"""
