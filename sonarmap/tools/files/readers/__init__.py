"""What files say: point clouds to scans, poses and pose graphs, priors.

In: paths and patterns. Out: `Scan`, `Trajectory`, `PoseGraph`, `PosePrior`, and `notes`, a list to which is added what
a user should know. A file that cannot be used raises InputError with its name, the line or packet, and what to do.
Everywhere `scans` are as the readers name and stamp them, `stamps` those of the scans (N,) [s, UTC], `settings` the
user's, and `where` a file and line for messages. A new scan format is a file in `clouds/` and a row of FORMATS.
"""
