"""A survey of any length whose registrations are made up from the truth, so that the mapper's own work is measured."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from sonarmap.spectral.result import Registration
from sonarmap.spectral.scan import Scan

# The vehicle moves to and fro over a rough bed: how far apart scans and lanes are, and how high it is [m].
_STEP, _LANE, _HEIGHT = 4.0, 15.0, 12.0
# What a scan sees of the bed: along the way and across [m].
_LONG, _WIDE = 16.0, 40.0
# Errors of a registration where both scans see the same: standard deviations [rad, m]; they grow as less is shared.
_TURN, _SHIFT = float(np.radians(0.1)), 0.05
# Variances that registrations tell, over those of their errors: what spectral ones have (`slam.graph.pose_covariance`).
_TOLD = 7.0
# Least overlap of what is found and accepted; so many of these are refused nevertheless, and so many loops are wrong.
_FOUND, _REFUSED, _WRONG = 0.25, 0.02, 0.002


@dataclass(frozen=True, slots=True)
class MadeUpSurvey:
    """Scans of a lawnmower path."""

    T_world_sensor: RigidTransform  # N poses, the truth
    scans: tuple[Scan, ...]  # N; their points lie on disk


def make_up(folder: Path, count: int, points: int, seed: int) -> MadeUpSurvey:
    """A survey of `count` scans of so many points each, whose points are written to a file in `folder`."""
    rng = np.random.default_rng(seed)
    truth = _path(count, rng)
    spooled = np.lib.format.open_memmap(folder / "points.npy", "w+", np.float32, (count, points, 3))
    for k in range(count):
        spooled[k] = _seen(truth[k], points, rng)
    spooled.flush()
    del spooled
    on_disk = np.load(folder / "points.npy", mmap_mode="r")
    scans = tuple(Scan(on_disk[k], stamp=float(k), name=f"scan{k}") for k in range(count))
    return MadeUpSurvey(truth, scans)


def _path(count: int, rng: np.random.Generator) -> RigidTransform:
    """To and fro in lanes, as many as make the place about square; the first pose is the identity."""
    per_lane = max(2, round(np.sqrt(count * _LANE / _STEP)))
    lane, along = np.divmod(np.arange(count), per_lane)
    back = lane % 2 == 1
    x = np.where(back, per_lane - 1 - along, along) * _STEP
    t = np.column_stack([x, lane * _LANE, np.zeros(count)]) + 0.2 * rng.normal(size=(count, 3))
    angles = np.radians([2.0, 2.0, 2.0]) * rng.normal(size=(count, 3))
    angles[:, 0] += np.where(back, np.pi, 0.0)
    T = RigidTransform.from_components(t, Rotation.from_euler("ZYX", angles))
    return T[0].inv() * T


def _seen(T: RigidTransform, points: int, rng: np.random.Generator) -> np.ndarray:
    """(points, 3) float32 [m, sensor frame] of the bed below a pose."""
    around = rng.uniform(-0.5, 0.5, (points, 2)) * [_LONG, _WIDE]
    R = Rotation.from_euler("Z", T.rotation.as_euler("ZYX")[0])
    xy = (R.apply(np.column_stack([around, np.zeros(points)])) + T.translation)[:, :2]
    z = _bed(*xy.T) + 0.05 * rng.normal(size=points)
    return T.inv().apply(np.column_stack([xy, z])).astype(np.float32)


def _bed(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Heights of a bed that nowhere repeats itself within a survey [m]."""
    waves = ((0.9, 0.11, 0.05), (0.5, -0.31, 0.23), (0.25, 0.71, 0.97), (0.12, -1.9, 1.3))
    return np.sum([size * np.sin(a * x + b * y) for size, a, b in waves], axis=0) - _HEIGHT


class MadeUpRegistrar:
    """Gives the truth with errors of the size that it tells, refuses what shares little, and is seldom wrong.

    Args:
        T_world_sensor: the poses of scan0, scan1, ...
        seed: of the errors; each pair has its own, whenever it is asked for.
    """

    def __init__(self, T_world_sensor: RigidTransform, seed: int) -> None:
        self._truth, self._seed = T_world_sensor, seed

    def prepare(self, scan: Scan) -> int:
        """The scan's number."""
        return int(scan.name.removeprefix("scan"))

    def register(self, target: int, source: int) -> Registration:
        """What is made up of a pair."""
        rng = np.random.default_rng([self._seed, target, source])
        T = self._truth[target].inv() * self._truth[source]
        shared = _shared(T)
        accepted = shared >= _FOUND and rng.random() >= _REFUSED
        wrong = not accepted or (abs(source - target) > 1 and rng.random() < _WRONG)
        sigmas = np.repeat([_TURN, _SHIFT], 3) / max(shared, _FOUND)
        error = rng.normal(size=6) * (np.repeat([0.2, 5.0], 3) if wrong else sigmas)
        return Registration(
            T_target_source=T * RigidTransform.from_exp_coords(error),
            covariance=np.diag(_TOLD * sigmas**2),
            psr=float("nan"),
            overlap=shared,
            accepted=accepted,
            seconds=0.0,
            reason="made up",
            probability=0.97 if accepted else 0.02,
        )


def _shared(T_target_source: RigidTransform) -> float:
    """The share of the bed that two scans both see, 0..1."""
    x, y, _ = np.abs(T_target_source.translation)
    return float(max(0.0, 1 - x / _LONG) * max(0.0, 1 - y / _WIDE))
