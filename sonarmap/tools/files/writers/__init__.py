"""What is written: points, trajectories, pose graphs, priors, tables, JSON.

In: arrays, trajectories, graphs. Out: files that appear whole or not at all (`atomic.py`); where one cannot be written,
InputError. A new format of points is a row of WRITERS in `points.py`, one of trajectories a row of TRAJECTORY_WRITERS
in `trajectory.py`; a row of FORMATS then offers it.
"""
