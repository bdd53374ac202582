"""Pose graphs: poses, the edges between them, priors of instruments, and their optimum by GTSAM.

In: measurements (`Edge`) and priors. Out: a `Solution` with poses, residuals and covariances. What GTSAM needs is in
`gtsam_poses.py` and `known_pose.py`; spanning trees and cut edges are in `edge.py`, and what fixes the gauge in
`gauge.py`.
"""
