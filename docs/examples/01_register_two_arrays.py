"""Register two point clouds without an initial guess."""

import numpy as np
from scipy.spatial.transform import RigidTransform

import sonarmap

rng = np.random.default_rng(1)


def seen_from(T_world_sensor: RigidTransform) -> np.ndarray:
    """Noisy points of a bed with boxes on it, within 30 m of a sensor and in its frame: (N, 3) [m]."""
    xy = rng.uniform(-45, 45, (60_000, 2))
    height = 0.6 * np.sin(xy[:, 0] / 5) * np.cos(xy[:, 1] / 7)
    for x, y, side, top in ((-12, 5, 6, 4), (8, -9, 4, 7), (15, 12, 8, 3), (-5, -18, 5, 5), (2, 16, 3, 6)):
        height[(abs(xy[:, 0] - x) < side / 2) & (abs(xy[:, 1] - y) < side / 2)] = top
    points = np.column_stack([xy, height + rng.normal(0, 0.05, len(xy))])
    near = np.linalg.norm(points - T_world_sensor.translation, axis=1) < 30
    return T_world_sensor.inv().apply(points[near])


# Two sensors 12 m above the bed. The truth, to compare with: 9 m and 40 degrees lie between them.
T_world_target = RigidTransform.from_translation([0, 0, 12])
T_true = RigidTransform.from_exp_coords([0, 0, np.deg2rad(40), 8.0, 4.0, 0.3])
target, source = seen_from(T_world_target), seen_from(T_world_target * T_true)

registration = sonarmap.register(target, source)

print(registration.T_target_source.as_matrix().round(2))
print(f"accepted: {registration.accepted}, because {registration.reason}")
error = T_true.inv() * registration.T_target_source
print(f"off by {np.linalg.norm(error.translation):.2f} m, {np.rad2deg(error.rotation.magnitude()):.2f} degrees")

# Scans that take part in several pairs are prepared once.
a, b = sonarmap.prepare([target, source])
print(f"again in {sonarmap.register(a, b).seconds:.2f} s")
