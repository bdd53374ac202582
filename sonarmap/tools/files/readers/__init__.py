"""Readers of scans, trajectories, pose graphs and priors.

They take paths and patterns and return `Scan`, `Trajectory`, `PoseGraph` or `PosePrior`; messages for the user are
appended to a list `notes`. An unusable file raises InputError with its name, the line or packet, and what to do.
Common arguments: `scans` (named and stamped by the readers), `stamps` of the scans (N,) [s, UTC], `settings` of the
user, and `where`, a file and line for messages. A new scan format is a file in `clouds/` and a row of FORMATS.
"""
