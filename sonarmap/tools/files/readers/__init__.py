"""What files say: point clouds to scans, poses and pose graphs, priors.

In: paths and patterns. Out: `Scan`, `Trajectory`, `PoseGraph`, `PosePrior`, and notes about what was dropped. A file
that cannot be used raises InputError with its name, the line or packet, and what to do. A new scan format is a file in
`clouds/` and a row of FORMATS in `file.py`.
"""
