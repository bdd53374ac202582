"""What the tests of the flood gate's maps share: a survey of five scans whose errors are known."""

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.scan import Scan
from sonarmap.tools.lab.reproduce.floodgate.chain import FloodgateSurvey
from sonarmap.tools.lab.simulate.shapes.solids import box, merge

SCANS = 5


def turn(yaw: float, pitch: float, roll: float) -> Rotation:
    return Rotation.from_euler("ZYX", [yaw, pitch, roll], degrees=True)


# p_world = T p_sensor; every pose has a turn about every axis
POSES = RigidTransform.concatenate(
    [
        RigidTransform.from_components([4.0 * k, -3 + k * k, 1.5 * k], turn(20 - 30 * k, 4 * k, -3 * k))
        for k in range(SCANS)
    ]
)
STEPS = [POSES[k - 1].inv() * POSES[k] for k in range(1, SCANS)]


def flat_survey() -> FloodgateSurvey:
    """Five scans of two boxes whose points lie exactly on the surface, the first scan's 0.25 m beside it."""
    rng = np.random.default_rng(7)
    places = rng.uniform(-20, 20, (SCANS, 400, 3)) * [1, 1, 0] + [0, 0, 2]  # on the lid of a flat box
    places[0, :, 2] += 0.25
    mesh = merge([box((0, 0, 1), (60, 60, 2)), box((15, 3, -9), (2, 4, 6))])
    scans = [
        Scan(POSES[k].inv().apply(places[k]).astype(np.float32), stamp=float(k), name=f"s{k}") for k in range(SCANS)
    ]
    return FloodgateSurvey(tuple(scans), POSES, mesh, overlap=(0.6, 0.7, 0.8, 0.9), shared=(0.9, 0.8, 0.7, 0.6))


def off(meters: float) -> list[RigidTransform]:
    """The true steps, the second one off by so much along its own z."""
    return [step * RigidTransform.from_translation([0, 0, meters * (k == 1)]) for k, step in enumerate(STEPS)]
