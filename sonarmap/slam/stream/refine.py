"""Registrations of the scans between key scans: to the nearer key scan, and to the other one if the first registration
does not agree with the motion. They are registered without an expected pose."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.pair import Candidate, RegisteredPair


@dataclass(frozen=True, slots=True)
class Between:
    scan: int  # between two key scans
    step: Edge  # from the key scan before it, by the motion of the key scans or by dead reckoning
    after: int  # the key scan after it
    T_keys: RigidTransform | None  # pose of the key scan after in the frame of the one before; None if unknown

    def candidates(self) -> tuple[Candidate, Candidate]:
        """The pairs with both key scans, the nearer one first."""
        sides = Candidate(self.step.i, self.scan, "sequential"), Candidate(self.scan, self.after, "sequential")
        return sides if self.scan - self.step.i <= self.after - self.scan else (sides[1], sides[0])

    def deviation(self, pair: RegisteredPair) -> "_Deviation | None":
        """By a registered pair; None if it is refused."""
        if pair.registration is None or not pair.accepted:
            return None
        T, covariance = pair.registration.T_target_source, pair.registration.covariance
        if pair.i == self.scan:  # this is the pose of the key scan after it, in the scan's frame
            if self.T_keys is None:
                return None
            T, covariance = self.T_keys * T.inv(), propagated(T, covariance)
        # only what the graph needs: a dense stream has many edges
        slim = replace(pair.registration, step_psr=(), alternatives=(), evidence=())
        edge = Edge(*pair.scans, slim, "sequential")
        return _Deviation(edge, self.step.registration.T_target_source.inv() * T, covariance)


@dataclass(frozen=True, slots=True)
class _Deviation:
    """Of a scan from its expected pose, with a covariance, body tangent."""

    edge: Edge
    T: RigidTransform
    covariance: np.ndarray

    def agrees(self, other: "_Deviation", floor: np.ndarray, bound: float) -> bool:
        away = np.asarray((self.T.inv() * other.T).as_exp_coords())
        return bool(lengths(away[None], (self.covariance + other.covariance + np.diag(floor**2))[None])[0] <= bound)


def refine(runner: PairRunner, scans: Sequence[Between], floor: np.ndarray, bound: float) -> dict[int, Edge]:
    """The edges of the scans whose registration to a key scan is accepted and agrees with where they are expected, or
    deviates from it as a scan beside it does: a sensor that jumped between two key scans is not back at once.

    Args:
        floor: (6,) standard deviations added to the difference of two poses [rad, m].
        bound: largest distance of two poses that agree [sigmas].
    """
    placed: dict[int, _Deviation] = {}
    others: list[tuple[int, _Deviation]] = []
    for side in range(2):
        left = [scan for scan in scans if scan.scan not in placed]
        for scan, pair in zip(left, runner.register([scan.candidates()[side] for scan in left]), strict=True):
            none = _Deviation(scan.step, RigidTransform.identity(), scan.step.registration.covariance)
            if (deviation := scan.deviation(pair)) is None:
                continue
            if deviation.agrees(none, floor, bound):
                placed[scan.scan] = deviation
            else:
                others.append((scan.scan, deviation))
    others.sort(key=lambda each: each[0])
    for k, deviation in (*others, *reversed(others)):
        beside = [placed[n] for n in (k - 1, k + 1) if n in placed]
        if k not in placed and any(deviation.agrees(other, floor, bound) for other in beside):
            placed[k] = deviation
    return {k: deviation.edge for k, deviation in placed.items()}
