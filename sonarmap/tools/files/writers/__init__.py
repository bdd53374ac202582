"""What is written: points, trajectories, pose graphs, priors, tables, JSON.

In: arrays, trajectories, graphs. Out: files that appear whole or not at all (`atomic.py`); where one cannot be written,
InputError.
"""
