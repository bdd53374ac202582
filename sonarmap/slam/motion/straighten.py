"""Scans that were bent by the sensor's motion while it took them, straightened by the way that a map has found."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.graph.trajectory import Trajectory
from sonarmap.slam.motion.continuous import ContinuousTrajectory
from sonarmap.slam.motion.turn_rates import TurnRates
from sonarmap.slam.pair import Pair
from sonarmap.spectral.point_store import PointStore
from sonarmap.spectral.scan import Scan

_FEWEST = 4  # scans in a row that tell how the sensor moved
# A scan takes no longer than to the next one, but for this share; else stamps and times are of different clocks.
_LONGER = 1.2
_IN_MEMORY = 1 << 26  # bytes of straightened points; the others are on disk
_MOST = 0.95  # of a scan's points this share moves by less than what is said of it


@dataclass(frozen=True, slots=True)
class Way:
    """By which way a map's N scans were straightened, so that they can be again."""

    trajectory: Trajectory  # their N poses, as of the map before
    runs: tuple[tuple[int, ...], ...]  # scans that are one way
    bent: bool  # whether these are the poses of scans as they were taken
    turned: bool  # whether turn rates helped


@dataclass(frozen=True, slots=True)
class Straightened:
    """N scans."""

    scans: tuple[Scan, ...]  # those whose way is known with their points where they were at the stamp, without times
    moved: np.ndarray  # (N,) by how much [m] all but a few of their points were moved; 0 of those that stay

    @classmethod
    def none(cls, scans: Sequence[Scan]) -> "Straightened":
        """The scans as they were taken."""
        return cls(tuple(scans), np.zeros(len(scans)))

    def farthest_from(self, other: "Straightened") -> float:
        """By how much [m] all but a few points differ, of the scan of which they differ most."""
        both = zip(self.scans, other.scans, strict=True)
        return max((_apart(one.points, another.points) for one, another in both if one is not another), default=0.0)


def straightened(
    scans: Sequence[Scan],
    trajectory: Trajectory,
    runs: Sequence[Sequence[int]],
    seen_from: float,
    bent: bool = False,
    turn_rates: TurnRates | None = None,
) -> Straightened:
    """The scans whose points have times, each point where the sensor's frame at the stamp has it.

    Args:
        scans: N, as they were taken.
        trajectory: their N poses.
        runs: scans that are one way, in the order of their stamps, which ascend.
        seen_from: points of a scan in which the sensor moves farther than this [m] say where it was.
        bent: whether these are the poses of scans as they were taken: one that is bent lies best where the sensor was
            in the middle of it.
        turn_rates: of the sensor, or None.
    """
    straight, moved, store = list(scans), np.zeros(len(scans)), PointStore(_IN_MEMORY)
    for run in runs:
        spans = [float(np.ptp(times)) for k in run if (times := scans[k].times) is not None]
        steps = np.diff(trajectory.stamps[list(run)])
        if len(run) < _FEWEST or not spans or np.median(spans) > _LONGER * np.median(steps):
            continue
        knots = trajectory.take(run)
        if bent:
            middles = np.array([0.0 if (times := scans[k].times) is None else times.mean() for k in run])
            knots = Trajectory(knots.stamps + middles, knots.T_world_sensor)
            if not (np.diff(knots.stamps) > 0).all():
                continue
        way = ContinuousTrajectory.through(knots, np.zeros((len(run), 6, 6)), turn_rates)
        first, last = 2 * knots.stamps[0] - knots.stamps[1], 2 * knots.stamps[-1] - knots.stamps[-2]
        for k in run:
            if (times := scans[k].times) is None:
                continue
            stamp = float(trajectory.stamps[k])
            asked, which = np.unique(np.append(stamp, stamp + times.astype(np.float64)), return_inverse=True)
            if asked[0] < first or asked[-1] > last:
                continue
            T = way.at(asked)[0].T_world_sensor
            T_stamp_time = T[int(which[0])].inv() * T
            if way.turned is not None:  # within a scan it errs less than what the scans' own poses leave over
                R = way.turned.at(asked)
                T_stamp_time = RigidTransform.from_components(T_stamp_time.translation, R[int(which[0])].inv() * R)
            scan, moved[k] = _straight(scans[k], T_stamp_time, which[1:], seen_from)
            viewpoints = None if scan.viewpoints is None else store.keep(scan.viewpoints)
            straight[k] = replace(scan, points=store.keep(scan.points), viewpoints=viewpoints)
    return Straightened(tuple(straight), moved)


def _straight(scan: Scan, T_stamp_time: RigidTransform, which: np.ndarray, seen_from: float) -> tuple[Scan, float]:
    """A scan whose point n was seen at pose `which[n]`, and how far its points were moved."""
    T = T_stamp_time[which]
    points = T.apply(scan.points.astype(np.float64))
    moved = _apart(points, scan.points)
    places = T.translation if scan.viewpoints is None else T.apply(scan.viewpoints.astype(np.float64))
    viewpoints = scan.viewpoints
    if viewpoints is not None or np.ptp(places, axis=0).max() > seen_from:
        viewpoints = places.astype(np.float32)
    return replace(scan, points=points.astype(np.float32), viewpoints=viewpoints, times=None), moved


def _apart(points: np.ndarray, others: np.ndarray) -> float:
    """By how much [m] all but a few of (M, 3) points are moved."""
    return float(np.quantile(np.linalg.norm(points - others, axis=1), _MOST))


def ways(components: Sequence[Sequence[int]], surveys: Sequence[int], stamps: np.ndarray) -> list[list[int]]:
    """Scans of one part and one survey in a row, as far as their stamps [s] ascend."""
    found: list[list[int]] = []
    for members in components:
        run: list[int] = []
        for k in sorted(members):
            if run and (surveys[k] != surveys[run[-1]] or stamps[k] <= stamps[run[-1]]):
                found.append(run)
                run = []
            run.append(k)
        found.append(run)
    return found


def sharper(pairs: Sequence[Pair], before: Sequence[Pair]) -> float:
    """How much sharper scans match than before: the logarithm of the ratio of their peaks, in the median of the pairs
    that were accepted both times; 0 where none were. Consecutive scans alone would not say: they are bent alike."""
    peaks = [{p.scans: p.registration.psr for p in each if p.accepted and p.registration} for each in (pairs, before)]
    both = peaks[0].keys() & peaks[1].keys()
    return float(np.median([np.log(peaks[0][scans] / peaks[1][scans]) for scans in both])) if both else 0.0
