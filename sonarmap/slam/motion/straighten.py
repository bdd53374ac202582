"""Straightening of scans that the sensor's motion bent while it took them, by the trajectory of a map."""

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

_MIN_SCANS = 4  # of a run that shows the sensor's motion
_MAX_DURATION = 1.2  # of a scan [intervals]; with longer ones, stamps and times are of different clocks
_IN_MEMORY = 1 << 26  # bytes of straightened points; the others are on disk
_MOST = 0.95  # share of a scan's points that are moved by no more than the reported distance


@dataclass(frozen=True, slots=True)
class Way:
    """The trajectory by which a map's N scans were straightened, to straighten them again."""

    trajectory: Trajectory  # their N poses in the map before
    runs: tuple[tuple[int, ...], ...]  # scans of one continuous trajectory each
    bent: bool  # whether the poses are of the original scans
    turned: bool  # whether turn rates were used


@dataclass(frozen=True, slots=True)
class Straightened:
    """N scans after straightening."""

    scans: tuple[Scan, ...]  # straightened ones have all points in the frame at the stamp, and no times
    moved: np.ndarray  # (N,) distance [m] by which most of their points were moved at most; 0 if unchanged

    @classmethod
    def none(cls, scans: Sequence[Scan]) -> "Straightened":
        """The original scans."""
        return cls(tuple(scans), np.zeros(len(scans)))

    def farthest_from(self, other: "Straightened") -> float:
        """The largest distance [m], over all scans, by which most points differ at most."""
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
    """The scans, with each point that has a time in the sensor's frame at the stamp.

    Args:
        scans: N original ones.
        trajectory: their N poses.
        runs: scans of one continuous trajectory each, with ascending stamps.
        seen_from: the sensor's motion within a scan [m] from which its points get viewpoints.
        bent: whether the poses are of the original scans: a bent scan fits best where the sensor was in the middle of
            it.
        turn_rates: of the sensor, or None.
    """
    straight, moved, store = list(scans), np.zeros(len(scans)), PointStore(_IN_MEMORY)
    for run in runs:
        spans = [float(np.ptp(times)) for k in run if (times := scans[k].times) is not None]
        steps = np.diff(trajectory.stamps[list(run)])
        if len(run) < _MIN_SCANS or not spans or np.median(spans) > _MAX_DURATION * np.median(steps):
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
            times_seen, which = np.unique(np.append(stamp, stamp + times.astype(np.float64)), return_inverse=True)
            if times_seen[0] < first or times_seen[-1] > last:
                continue
            T = way.at(times_seen)[0].T_world_sensor
            T_stamp_time = T[int(which[0])].inv() * T
            if way.turned is not None:  # within a scan, turn rates are more accurate than the poses of scans
                R = way.turned.at(times_seen)
                T_stamp_time = RigidTransform.from_components(T_stamp_time.translation, R[int(which[0])].inv() * R)
            scan, moved[k] = _straight(scans[k], T_stamp_time, which[1:], seen_from)
            viewpoints = None if scan.viewpoints is None else store.keep(scan.viewpoints)
            straight[k] = replace(scan, points=store.keep(scan.points), viewpoints=viewpoints)
    return Straightened(tuple(straight), moved)


def _straight(scan: Scan, T_stamp_time: RigidTransform, which: np.ndarray, seen_from: float) -> tuple[Scan, float]:
    """A scan whose point n was seen from pose `which[n]`, straightened, and the distance by which its points moved."""
    T = T_stamp_time[which]
    points = T.apply(scan.points.astype(np.float64))
    moved = _apart(points, scan.points)
    places = T.translation if scan.viewpoints is None else T.apply(scan.viewpoints.astype(np.float64))
    viewpoints = scan.viewpoints
    if viewpoints is not None or np.ptp(places, axis=0).max() > seen_from:
        viewpoints = places.astype(np.float32)
    return replace(scan, points=points.astype(np.float32), viewpoints=viewpoints, times=None), moved


def _apart(points: np.ndarray, others: np.ndarray) -> float:
    """Distance [m] by which most of (M, 3) points differ at most."""
    return float(np.quantile(np.linalg.norm(points - others, axis=1), _MOST))


def ways(components: Sequence[Sequence[int]], surveys: Sequence[int], stamps: np.ndarray) -> list[list[int]]:
    """Runs of scans of one component and survey, with ascending stamps [s]."""
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
    """How much sharper scans match than before: the median logarithm of the ratio of peaks, over pairs accepted both
    times; 0 without any. Loops are included, as consecutive scans are bent in the same way, and match even so."""
    peaks = [{p.scans: p.registration.psr for p in each if p.accepted and p.registration} for each in (pairs, before)]
    both = peaks[0].keys() & peaks[1].keys()
    return float(np.median([np.log(peaks[0][scans] / peaks[1][scans]) for scans in both])) if both else 0.0
