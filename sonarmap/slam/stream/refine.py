"""The scans between key scans, each registered to the key scan next to it, and to the other one where that is not
enough: like any pair, by the scans alone, and not about where a steady motion has them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import RigidTransform

from sonarmap.slam.execute.runner import PairRunner
from sonarmap.slam.graph.edge import Edge
from sonarmap.slam.graph.tangent import lengths, propagated
from sonarmap.slam.pair import Candidate, RegisteredPair
from sonarmap.spectral.chi_squared import chi_squared_beyond

_AGREE_SIGMAS = float(np.sqrt(chi_squared_beyond(1e-3, 6)))  # between two poses of a scan that agree
_JUMP = 6.0  # times the usual distance from the path between its neighbors, from which a scan is out of place
_TO_SIGMA = 1.4826  # from a median of absolute numbers
_FASTER = 2.0  # times its usual speed that a vehicle may have at a jump
_MOST_ROUNDS = 50  # of leaving out the scans farthest from their neighbors


@dataclass(frozen=True, slots=True)
class Between:
    scan: int
    step: Edge  # from the key scan before it: as a steady motion, or dead reckoning, has it
    after: int  # the key scan behind it
    T_keys: RigidTransform | None  # of the key scan behind it, in the frame of the one before; None where not known

    def candidates(self) -> tuple[Candidate, Candidate]:
        """The pairs with both key scans, that with the nearer one first."""
        sides = Candidate(self.step.i, self.scan, "sequential"), Candidate(self.scan, self.after, "sequential")
        return sides if self.scan - self.step.i <= self.after - self.scan else (sides[1], sides[0])


@dataclass(frozen=True, slots=True)
class Refined:
    """How scans lie to key scans.

    Attributes:
        edges: by scan, from registrations that can be believed; of a scan that none holds what motion says.
        left: the scans that no registration holds.
        registered: what was registered, by the scans of a pair.
    """

    edges: dict[int, list[Edge]]
    left: list[int]
    registered: dict[tuple[int, int], RegisteredPair]


def refine(runner: PairRunner, scans: Sequence[Between], floor: np.ndarray) -> Refined:
    """How the scans lie to key scans: by registrations that can be believed, else as the steps have them.

    A registration that is accepted is believed where it agrees with the step, or with that to the other key scan.

    Args:
        floor: (6,) standard deviations that every two are granted between them [rad, m].
    """
    first = {pair.scans: pair for pair in runner.register([each.candidates()[0] for each in scans])}
    agreed = {each.scan: _agreeing(each, first, floor) for each in scans}
    more = [each.candidates()[1] for each in scans if not agreed[each.scan]]
    both = first | {pair.scans: pair for pair in runner.register(more)}
    edges: dict[int, list[Edge]] = {}
    for each in scans:
        edges[each.scan] = agreed[each.scan] or _agreeing(each, both, floor) or [each.step]
    return Refined(edges, [each.scan for each in scans if edges[each.scan][0] is each.step], both)


def without_leaps(
    runner: PairRunner,
    scans: Sequence[Between],
    refined: Refined,
    keys: Mapping[int, RigidTransform],
    times: np.ndarray,
    runs: np.ndarray,
    floor: np.ndarray,
) -> Refined:
    """The same without registrations by which a scan leaps out of its neighbors' way: by that to the other key scan, if
    it lies on the way then, else where the way has it.

    Args:
        runner: of all N scans.
        keys: poses of the key scans.
        times: (N,) [s].
        runs: (N,) equal for scans that follow one another in one map; below 0 of scans without a place.
    """
    poses = dict(keys)
    for each in scans:
        edge = refined.edges[each.scan][0]
        T_i_j = edge.registration.T_target_source
        poses[each.scan] = poses[edge.i] * T_i_j if edge.j == each.scan else poses[edge.j] * T_i_j.inv()
    chosen = np.array([k for k in sorted(poses) if runs[k] >= 0])
    if not len(chosen):
        return refined
    T_chosen = RigidTransform.concatenate([poses[k] for k in chosen.tolist()])
    leaps = find_leaps(T_chosen, times[chosen], runs[chosen], np.isin(chosen, list(keys)), floor)
    by_scan, edges = {each.scan: each for each in scans}, dict(refined.edges)
    leaping = [by_scan[k] for k in chosen[leaps.scans].tolist()]
    asked = [c for each in leaping for c in each.candidates() if c.scans not in refined.registered]
    registered = refined.registered | {pair.scans: pair for pair in runner.register(asked)}
    left = set(refined.left)
    for each, T_way, sigmas, back in zip(leaping, leaps.T, leaps.sigmas, leaps.back, strict=True):
        T_key = poses[each.step.i]
        way = replace(each.step.registration, T_target_source=T_key.inv() * T_way, covariance=np.diag(sigmas**2))
        on_way = replace(each, step=replace(each.step, registration=way))
        # in places that look alike two wrong ones can agree with one another
        believed = _on_way(on_way, registered, floor) if back else _agreeing(on_way, registered, floor)
        # beside the way: a registration that leaves much open agrees with it and holds the scan elsewhere
        edges[each.scan] = [*believed, on_way.step] if back or not believed else believed
        left |= set() if believed else {each.scan}
    return Refined(edges, sorted(left), registered)


def _agreeing(between: Between, registered: Mapping[tuple[int, int], RegisteredPair], floor: np.ndarray) -> list[Edge]:
    """The registrations of a scan that can be believed, none or one or both."""
    edges, places = _places(between, registered)
    if len(edges) == 2 and _agree(places[0], places[1], floor):
        return edges
    return _on_way(between, registered, floor)[:1]


def _on_way(between: Between, registered: Mapping[tuple[int, int], RegisteredPair], floor: np.ndarray) -> list[Edge]:
    step = between.step.registration.T_target_source, between.step.registration.covariance
    return [edge for edge, place in zip(*_places(between, registered), strict=True) if _agree(step, place, floor)]


def _places(
    between: Between, registered: Mapping[tuple[int, int], RegisteredPair]
) -> tuple[list[Edge], list[tuple[RigidTransform, np.ndarray]]]:
    """The registrations of a scan that are accepted, and where they have it in the frame of the key scan before it,
    with covariances, body tangent."""
    edges: list[Edge] = []
    places: list[tuple[RigidTransform, np.ndarray]] = []
    for candidate in between.candidates():
        pair = registered.get(candidate.scans)
        if pair is None or pair.registration is None or not pair.accepted:
            continue
        place = pair.registration.T_target_source, pair.registration.covariance
        if pair.i == between.scan:  # then of the key scan behind it, seen from here
            if between.T_keys is None:
                continue
            place = between.T_keys * place[0].inv(), propagated(*place)
        places.append(place)
        edges.append(Edge(*pair.scans, pair.registration, "sequential"))
    return edges, places


def _agree(one: tuple[RigidTransform, np.ndarray], other: tuple[RigidTransform, np.ndarray], floor: np.ndarray) -> bool:
    """Whether two that say where a scan is, with their covariances, body tangent, say the same."""
    away = np.asarray((one[0].inv() * other[0]).as_exp_coords())
    return bool(lengths(away[None], (one[1] + other[1] + np.diag(floor**2))[None])[0] <= _AGREE_SIGMAS)


@dataclass(frozen=True, slots=True)
class Leaps:
    """What does not lie on the way.

    Attributes:
        scans: (n,) int, ascending.
        T: where the way between their neighbors has them, n poses.
        sigmas: (n, 6) standard deviations of that [rad, m].
        back: (n,) bool, whether the scan behind is where the vehicle would be without the leap: nothing goes so far and
            back from one scan to the next.
    """

    scans: np.ndarray
    T: RigidTransform
    sigmas: np.ndarray
    back: np.ndarray


def find_leaps(T: RigidTransform, times: np.ndarray, runs: np.ndarray, fixed: np.ndarray, floor: np.ndarray) -> Leaps:
    """The scans that stray far from a steady motion from the scan before to the one behind.

    Args:
        times: (N,) [s], ascending within a run.
        runs: (N,) equal for scans that follow one another in one map.
        fixed: (N,) bool, of scans that are right.
        floor: (6,) what scans may stray at least [rad, m].
    """
    left: np.ndarray = np.arange(len(times))
    if len(left) < 3:
        return Leaps(left[:0], T[left[:0]], np.zeros((0, 6)), np.zeros(0, bool))
    strayed = _strayed(T, times, left)
    inside = runs[left[:-2]] == runs[left[2:]]
    usual = np.maximum(_TO_SIGMA * np.median(np.abs(strayed[inside]), axis=0), floor) if inside.any() else floor
    step = float(np.median(np.diff(times)[np.diff(runs) == 0])) if inside.any() else 1.0
    for _ in range(_MOST_ROUNDS):
        far = np.linalg.norm(_strayed(T, times, left) / usual, axis=1)
        # a longer way between neighbors may be less steady
        far /= np.maximum((times[left[2:]] - times[left[:-2]]) / (2 * step), 1.0)
        far = np.pad(np.where((runs[left[:-2]] == runs[left[2:]]) & ~fixed[left[1:-1]], far, 0.0), 1)
        leaping = (far > _JUMP) & (far >= np.roll(far, 1)) & (far >= np.roll(far, -1))
        if not leaping.any() or len(left) - leaping.sum() < 3:
            break
        left = left[~leaping]
    gone = np.setdiff1d(np.arange(len(times)), left)
    behind = np.searchsorted(left, gone)
    before, after = left[behind - 1], left[behind]
    longer = np.maximum((times[after] - times[before]) / (2 * step), 1.0)
    ways, spans = _ways(T, before, after), times[after] - times[before]
    same = np.flatnonzero(np.diff(runs) == 0)
    speeds = np.median(_ways(T, same, same + 1) / np.maximum(np.diff(times)[same, None], 1e-9), axis=0)
    most = _FASTER * speeds * spans[:, None] + _JUMP * np.linalg.norm(usual.reshape(2, 3), axis=1)
    return Leaps(gone, _between(T, times, before, gone, after), longer[:, None] * usual, (ways <= most).all(axis=1))


def _ways(T: RigidTransform, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """(n, 2) how far poses are apart [rad, m]."""
    apart = T[i].inv() * T[j]
    return np.column_stack([apart.rotation.magnitude(), np.linalg.norm(apart.translation, axis=1)])


def _strayed(T: RigidTransform, times: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(n - 2, 6) how far all but the first and the last of some scans are from the way between those beside them."""
    between = _between(T, times, left[:-2], left[1:-1], left[2:])
    return np.asarray((between.inv() * T[left[1:-1]]).as_exp_coords())


def _between(
    T: RigidTransform, times: np.ndarray, before: np.ndarray, own: np.ndarray, after: np.ndarray
) -> RigidTransform:
    """Where a steady motion from one scan to another passes at the time of a third."""
    share = (times[own] - times[before]) / np.maximum(times[after] - times[before], 1e-9)
    way = np.asarray((T[before].inv() * T[after]).as_exp_coords())
    return T[before] * RigidTransform.from_exp_coords(share[:, None] * way)
