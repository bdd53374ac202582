"""Faulty scans, which are mirrored or in another unit: sought among the scans that no free registration holds."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations

import numpy as np
from scipy.constants import foot

from sonarmap.slam.decide.decision import Decision
from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.pose_graph import Solution
from sonarmap.slam.graph.tangent import lengths
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.scan import Scan

MAX_TRIED = 5  # scans that no free registration holds; with more the survey is weak, and its scans are not faulty


@dataclass(frozen=True, slots=True)
class Change:
    """A change of a scan's points and viewpoints: mirrored along axes, and scaled."""

    axes: str = ""  # of "xyz", whose signs change
    factor: float = 1.0  # of all lengths

    def of(self, scan: Scan) -> Scan:
        """The changed scan; its prior, which is the vehicle's, stays."""
        by = np.array([-self.factor if axis in self.axes else self.factor for axis in "xyz"], np.float32)
        seen_from = None if scan.viewpoints is None else scan.viewpoints * by
        return replace(scan, points=scan.points * by, viewpoints=seen_from)


@dataclass(frozen=True, slots=True)
class OddScan:
    """A faulty scan, which is in no map.

    Attributes:
        scan: its number.
        change: with which it fits its neighbors.
    """

    scan: int
    change: Change

    @property
    def kind(self) -> str:
        """ "mirrored", "feet", or "meters" among scans in feet."""
        if self.change.axes:
            return "mirrored"
        return "feet" if self.change.factor < 1 else "meters"


def find_odd(
    runner: PairRunner, scans: Sequence[Scan], runs: np.ndarray, decision: Decision, floor: np.ndarray, bound: float
) -> tuple[OddScan, ...]:
    """The scans that are mirrored, or in feet among meters, by their numbers.

    Such a scan is in no map, or only by pairs that were sought at expected poses, where such pairs are found, rightly
    or not. The changed scan fits two neighbors of one map, up to two scans away, which agree on its place; unchanged it
    does not.

    Args:
        runner: of the scans.
        scans, runs: N, and (N,) the numbers of the runs in which consecutive scans are registered.
        decision: about them.
        floor: (6,) standard deviations added in quadrature to those of each registration [rad, m].
        bound: largest distance of two registrations that agree [sigmas].
    """
    graph, sought = decision.solution.graph, {pair.scans for pair in decision.pairs if pair.expected is not None}
    holding = [edge for edge in graph.edges if edge.by_hand or (edge.i, edge.j) not in sought]
    held = {k for edge in holding for k in (edge.i, edge.j)}.union(point.scan for point in graph.control)
    suspects = [k for k in range(len(scans)) if k not in held]
    odd: list[OddScan] = []
    for k in suspects if len(suspects) <= MAX_TRIED else []:
        neighbors = [j for j in (k - 2, k - 1, k + 1, k + 2) if j in held and runs[j] == runs[k]]
        if len(neighbors) < 2:
            continue
        change = _change(scans[k], [scans[j] for j in neighbors])
        candidates = [Candidate(j, len(scans), "loop") for j in neighbors]
        changed, unchanged = (runner.beside([each], [k]) for each in (change.of(scans[k]), scans[k]))
        fits = _agree(changed.register(candidates), decision.solution, floor, bound)
        if fits and not _agree(unchanged.register(candidates), decision.solution, floor, bound):
            odd.append(OddScan(k, change))
    return tuple(odd)


def _agree(pairs: Sequence[RegisteredPair], solution: Solution, floor: np.ndarray, bound: float) -> bool:
    """Whether two accepted registrations of a scan with scans of one map agree on its place."""
    places = [(pair.i, pair.registration) for pair in pairs if pair.registration and pair.accepted]
    part = {k: number for number, members in enumerate(solution.graph.components) for k in members}
    T = solution.trajectory.T_world_sensor
    for (i, first), (j, second) in combinations(places, 2):
        apart = (T[i] * first.T_target_source).inv() * T[j] * second.T_target_source
        covariance = first.covariance + second.covariance + 2 * np.diag(floor**2)
        if part[i] == part[j] and lengths(apart.as_exp_coords()[None], covariance[None])[0] <= bound:
            return True
    return False


def _change(scan: Scan, neighbors: Sequence[Scan]) -> Change:
    """The change that makes a scan most like its neighbors: of its unit, if it has another size; or else mirrored along
    z if it then sees the bed where they do, or along y. Along x is along y and a turn about z."""
    ratio = _size(scan) / max(float(np.median([_size(each) for each in neighbors])), 1e-9)
    factor = min((1.0, foot, 1 / foot), key=lambda factor: abs(np.log(max(factor * ratio, 1e-9))))
    if factor != 1:
        return Change(factor=factor)
    height, usual = _height(scan), float(np.median([_height(each) for each in neighbors]))
    return Change("z" if abs(height + usual) < abs(height - usual) else "y")


def _size(scan: Scan) -> float:
    """The median distance of the points from the sensor [m]."""
    return float(np.median(np.linalg.norm(scan.points, axis=1)))


def _height(scan: Scan) -> float:
    """The median height of the points over the sensor [m]."""
    return float(np.median(scan.points[:, 2]))
