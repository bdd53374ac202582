"""Rotations in, a few tested hypotheses out: each with its pose and all that was measured of it.

`hypothesis_testing.py` runs the test of one pair: `bounds.py` says which poses are possible, `verifier.py` finds
candidate poses under each rotation (`candidates.py`), `icp.py` refines them, with what instruments measured
(`pair_frames.py`, `prior_term.py`), and the verifier reads their evidence (`hypothesis.py`, `shared_surface.py`).
`observability.py` looks at how sharply the scans agree at the best. `spectral/judge` says what that is worth; only it
and `spectral/registration.py` import this package.
"""
