# pyright: strict, reportMissingTypeStubs=false, reportUnknownMemberType=false
# pyright: reportUnknownVariableType=false, reportUnknownArgumentType=false
"""Navigation as it comes: fixes now and then, some of them wrong, and dead reckoning that drifts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.scan import PosePrior
from sonarmap.tools.lab.simulate.sensing.dive_seed import entropy_of

STREAM = 37  # of the seed: drawn apart from the scans and from what instruments measure
OUTLIER = 20.0  # how far a wrong fix is off [m]
# Of dead reckoning from scan to scan, beside its drift [rad, m].
_SHAKE = np.repeat([np.radians(0.02), 0.002], 3)


@dataclass(frozen=True, slots=True)
class Fixes:
    """How positions are fixed.

    Attributes:
        every: only every so many-th scan has a position, beginning with the first.
        outliers: share of the positions that are 20 m off, 0..1.

    Raises:
        InputError: a number below 1, or a share out of its range.
    """

    every: int = 1
    outliers: float = 0.0

    def __post_init__(self) -> None:
        if self.every < 1 or not 0 <= self.outliers <= 1:
            raise InputError(f"`fix_every={self.every}`, `fix_outliers={self.outliers}`: wanted at least 1, and 0 to 1")

    def of(self, priors: Sequence[PosePrior], seed: int, dive: int = 1) -> list[PosePrior | None]:
        """The priors with positions fixed so; None where nothing is left. Depths are those of every scan."""
        rng = np.random.default_rng(entropy_of(seed, STREAM, 0, dive=dive))
        wrong, angle = rng.random(len(priors)) < self.outliers, rng.uniform(0, 2 * np.pi, len(priors))
        changed: list[PosePrior | None] = []
        for k, prior in enumerate(priors):
            away = OUTLIER * wrong[k] * np.array([np.cos(angle[k]), np.sin(angle[k]), 0.0])
            T = RigidTransform.from_translation(away) * prior.T_world_sensor
            sigmas = prior.sigmas.copy()
            if k % self.every:
                sigmas[3:5] = np.inf
            changed.append(replace(prior, T_world_sensor=T, sigmas=sigmas) if np.isfinite(sigmas).any() else None)
        return changed


def dead_reckoning(truth: Trajectory, drift: float, turn_drift: float, seed: int, dive: int = 1) -> Trajectory:
    """Where a vehicle believes it went: its log is off by a share of the way, its gyroscope by a turn per second.

    Both are drawn once for the dive, with these standard deviations; from scan to scan comes a little more.

    Args:
        truth: the true poses, stamps in seconds.
        drift: of the way, as a share of it.
        turn_drift: of the heading [rad/s].
        seed, dive: decide what is drawn.
    """
    rng = np.random.default_rng(entropy_of(seed, STREAM, 1, dive=dive))
    scale, rate = drift * rng.standard_normal(), turn_drift * rng.standard_normal()
    aside = drift * rng.standard_normal()
    T = truth.T_world_sensor
    poses = [T[0]]
    for k in range(1, len(T)):
        step = T[k - 1].inv() * T[k]
        off = Rotation.from_euler("Z", aside).apply((1 + scale) * step.translation)
        turned = Rotation.from_euler("Z", rate * (truth.stamps[k] - truth.stamps[k - 1])) * step.rotation
        shake = RigidTransform.from_exp_coords(_SHAKE * rng.standard_normal(6))
        poses.append(poses[-1] * RigidTransform.from_components(off, turned) * shake)
    return Trajectory(truth.stamps, poses[0].inv() * RigidTransform.concatenate(poses))
