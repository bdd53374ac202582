"""Pose graphs: poses, the edges between them, priors of instruments, and their optimum by GTSAM.

In: measurements (`Edge`) and priors. Out: a `Solution` with poses, residuals and covariances. What GTSAM needs is in
`gtsam_poses.py` and `known_pose.py`; paths and spanning trees are in `path.py` and `edge.py`.
"""
