"""Rotations in, a few tested hypotheses out: each with its pose, its evidence, its covariance and its probability.

`verifier.py` finds candidate poses under each rotation and measures the evidence, `icp.py` refines them,
`hypothesis_test.py` runs the test of one pair, `bounds.py` says which poses are possible, `covariance.py` and
`probability.py` say how sure the result is. Only `spectral/registration.py` imports this package.
"""
