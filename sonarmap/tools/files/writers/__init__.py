"""Writers of point clouds, trajectories, pose graphs, priors, tables and JSON.

Every file is written atomically (`atomic.py`): it appears whole or not at all. A failed write raises InputError.
"""
