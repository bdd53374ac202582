"""The simulator: scans of built scenes with known true poses.

In: settings (a scene, a path, a sensor, noise, a seed). Out: scans, true poses and priors, the same for the same seed.
Each part uses only those before it: `scenes` (meshes of the world), `sensing` (echoes, noise, instruments),
`trajectories.py` on `routes.py` (where the sensor goes), `simulation.py`, `plan.py` and `folder.py`; `random_pairs.py`
and `kinds` make pairs of scans.
"""
