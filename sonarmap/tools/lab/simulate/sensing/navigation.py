"""Simulated navigation: priors of poses with errors, position fixes at intervals and with outliers, and dead reckoning
that drifts."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.kernels.errors import InputError
from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.spectral.geometry import twist
from sonarmap.spectral.scan import PosePrior


def entropy_of(*words: int, dive: int) -> list[int]:
    """The entropy of a generator's SeedSequence: `words`, and the dive's number unless it is the first dive."""
    return [*words] if dive == 1 else [*words, dive]


INSTRUMENT_STREAM = 31  # of the seed, so that the scans do not depend on the errors


@dataclass(frozen=True, slots=True)
class Instruments:
    """Standard deviations of a vehicle's instruments; inf for those that it lacks."""

    attitude: float = float(np.deg2rad(0.5))  # of roll and of pitch [rad]; an inertial sensor's
    heading: float = float(np.deg2rad(3.0))  # [rad]; a magnetic compass near steel
    depth: float = 0.1  # [m]; a pressure sensor's, with waves
    position: float = 3.0  # of East and of North [m]; acoustic positioning

    @property
    def sigmas(self) -> np.ndarray:
        """(6,) float64 in PosePrior's order [rad, m]."""
        return np.array([self.attitude] * 2 + [self.heading] + [self.position] * 2 + [self.depth])


KINDS = tuple(Instruments.__dataclass_fields__)


def instruments_for(kinds: Sequence[str], fix_sigma: float | None = None) -> Instruments:
    """Instruments of these KINDS only, with default standard deviations except `fix_sigma`, that of positions [m].
    Raises InputError: an unknown kind, no kind, or a standard deviation that is not positive."""
    unknown = [kind for kind in kinds if kind not in KINDS]
    if unknown or not kinds:
        what = repr(unknown[0]) if unknown else "nothing"
        raise InputError(f"no instrument measures {what}; choose from {','.join(KINDS)}, separated by commas, or all")
    if fix_sigma is not None and not 0 < fix_sigma < np.inf:
        raise InputError(f"`fix_sigma={fix_sigma:g}`: wanted meters above 0")
    carried = Instruments() if fix_sigma is None else Instruments(position=fix_sigma)
    return replace(carried, **{kind: np.inf for kind in KINDS if kind not in kinds})


def measure_poses(
    T_world_sensor: RigidTransform, instruments: Instruments, seed: int, dive: int = 1
) -> tuple[PosePrior, ...]:
    """Priors of N poses; the errors of each depend only on the seed, the dive and the number of the pose."""
    entropy = entropy_of(seed, INSTRUMENT_STREAM, dive=dive)
    streams = (np.random.SeedSequence(entropy, spawn_key=(number,)) for number in range(len(T_world_sensor)))
    return tuple(
        measure_pose(T_world_sensor[number], instruments, np.random.default_rng(stream))
        for number, stream in enumerate(streams)
    )


def measure_pose(T_world_sensor: RigidTransform, instruments: Instruments, rng: np.random.Generator) -> PosePrior:
    """Prior of one true pose with normal errors; components that no instrument measures are 0."""
    sigmas = instruments.sigmas
    drawn = rng.normal(size=6)
    carried = np.isfinite(sigmas)
    errors = np.where(carried, sigmas, 0.0) * drawn
    about_world = Rotation.from_euler("Z", twist(T_world_sensor.rotation)).apply(errors[:3])
    yaw, pitch, roll = (Rotation.from_rotvec(-about_world) * T_world_sensor.rotation).as_euler("ZYX")
    measured = np.where(carried[[2, 1, 0]], [yaw, pitch, roll], 0.0)
    shift = np.where(carried[3:], T_world_sensor.translation - errors[3:], 0.0)
    return PosePrior(RigidTransform.from_components(shift, Rotation.from_euler("ZYX", measured)), sigmas)


STREAM = 37  # of the seed, so that scans and priors do not depend on these draws
OUTLIER = 20.0  # horizontal error of a wrong fix [m]
# Standard deviations of dead reckoning per scan, in addition to its drift [rad, m]
_SHAKE = np.repeat([np.radians(0.02), 0.002], 3)


@dataclass(frozen=True, slots=True)
class Fixes:
    """Interval and outliers of position fixes. Raises InputError: `every` is below 1, or `outliers` outside 0..1."""

    every: int = 1  # interval of the scans with a position, beginning with the first
    outliers: float = 0.0  # share of the positions that are 20 m off, 0..1

    def __post_init__(self) -> None:
        if self.every < 1 or not 0 <= self.outliers <= 1:
            raise InputError(f"`fix_every={self.every}`, `fix_outliers={self.outliers}`: wanted at least 1, and 0 to 1")

    def of(self, priors: Sequence[PosePrior], seed: int, dive: int = 1) -> list[PosePrior | None]:
        """The priors with only these positions; None if nothing else is measured. Depths of all scans stay."""
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
    """Trajectory by dead reckoning: the speed log errs in scale and direction, the gyroscope has a constant bias.

    The errors are drawn once per dive, with the standard deviations `drift`, a share of the distance, and `turn_drift`
    [rad/s]; a little noise is added per scan. The truth's stamps are in seconds.
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
