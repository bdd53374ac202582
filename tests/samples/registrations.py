"""Registrations that are off by as much as a test says."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.result import Registration
from sonarmap.tools.lab.reproduce.gaussian.scored import ScoredRegistration

TRUTH = RigidTransform.from_components([20, -7, 3], Rotation.from_euler("ZYX", [170, 4, -9], degrees=True))
CENTER = np.array([40.0, 15.0, -12.0])


def scored(yaw: float = 0, pitch: float = 0, shift: float = 0, voxel: float = 2.0) -> ScoredRegistration:
    """One that is off by so many degrees of yaw and pitch, turned about the scan's center, and by meters in x."""
    angles = TRUTH.rotation.as_euler("ZYX", degrees=True) + np.array([yaw, pitch, 0])
    R = Rotation.from_euler("ZYX", angles, degrees=True)
    translation = TRUTH.apply(CENTER) - R.apply(CENTER) + np.array([shift, 0, 0])
    found = RigidTransform.from_components(translation, R)
    steps = (("yaw", 9.0), ("tilt", 8.0), ("translation", 50.0), ("rival", 7.0))
    registration = Registration(found, np.eye(6), 50.0, 0.5, True, 0.25, step_psr=steps)
    return ScoredRegistration(registration, TRUTH, CENTER, voxel)
