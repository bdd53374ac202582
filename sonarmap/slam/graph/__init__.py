"""Pose graphs: poses, the edges between them, instruments' priors, and their optimum by GTSAM.

In: measurements (`Edge`) and priors. Out: a `Solution` with poses, residuals and covariances. `edge.py` has spanning
trees, `gauge.py` fixes the gauge, and `factors.py` and `known_pose.py` make GTSAM's factors.
"""
