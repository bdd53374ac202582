"""The simulator: scans of scenes whose truth is known.

In: settings (a scene, a path, a sensor, noise, a seed). Out: scans, true poses and priors, the same for the same seed.
Each room uses only those before it: `shapes` (meshes), `scenes` (what stands where), `sensing` (echoes, noise,
instruments), `paths` (where the sensor goes), then `simulation.py`, `plan.py` and `folder.py`, then `pairs` (pairs of
scans to judge a registration by).
"""
